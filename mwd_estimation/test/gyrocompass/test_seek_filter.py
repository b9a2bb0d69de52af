"""The compiled filter of north seeking: its Jacobian, its start, and what it carries on."""

from __future__ import annotations

import math

import numpy as np
from north_signals import DEG_H, felt, motion, still
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from mwd_estimation.gyrocompass import north_seek
from mwd_estimation.gyrocompass.seek_filter import (
    AXIS,
    BIAS,
    CARRIED,
    EARTH,
    K_B,
    K_BX,
    K_HORIZONTAL,
    K_VERTICAL,
    LAG,
    LEAD,
    PHASE,
    PHI,
    SEEKING,
    STATES,
    SUMS,
    VEL,
    advance,
    frame,
    sample,
    transition,
)  # fmt: skip
from mwd_estimation.gyrocompass.seek_params import SeekParams, kernel_settings
from mwd_sensors.core.frames import mat_nt

DEG = math.radians(1.0)


def test_transition_is_the_derivative_of_the_integration() -> None:
    rng = np.random.default_rng(6)
    params = SeekParams()
    k = kernel_settings(params)
    k[K_VERTICAL] *= 100.0
    x = np.zeros(STATES)
    x[EARTH:AXIS] = rng.standard_normal(AXIS - EARTH) * 1e-3
    x[EARTH : EARTH + 2] = [0.006, -0.004]
    x[LAG] = 0.02
    mat = mat_nt(1.1, 0.3, 0.7)
    rates, forces = rng.standard_normal((10, 3)) * 0.3, rng.standard_normal((10, 3)) * 4.0
    rates[:, 0] += 3.0

    def after(error: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        y = x + np.concatenate([np.zeros(VEL), error[VEL:]])
        m = (Rotation.from_rotvec(error[PHI : PHI + 3]).as_matrix() @ mat).ravel()
        s = np.zeros(SUMS)
        for w, f in zip(rates, forces, strict=True):
            sample(k, m, np.zeros(9), y, s, 0.002, w, f)
        return m.reshape(3, 3), y, s

    base, _, sums = after(np.zeros(STATES))
    phi = np.zeros((5, STATES))
    transition(k, x, sums, phi)
    numeric, step = np.zeros((5, STATES)), 1e-5
    for j in [*range(AXIS), LEAD]:
        (m1, y1, _), (m0, y0, _) = after(step * np.eye(STATES)[j]), after(-step * np.eye(STATES)[j])
        difference = Rotation.from_matrix(m1 @ base.T).as_rotvec() - Rotation.from_matrix(m0 @ base.T).as_rotvec()
        numeric[:3, j] = difference / (2.0 * step)
        numeric[3:, j] = (y1 - y0)[VEL : VEL + 2] / (2.0 * step)
    # The lag column holds for the Earth rate alone, not for these rates; that it works is shown with a lag above.
    without_lag = [j for j in range(STATES) if j != LAG]
    scale = np.maximum(np.abs(numeric).max(axis=0), 1e-3)
    assert_allclose((phi / scale)[:, without_lag], (numeric / scale)[:, without_lag], atol=0.05)


def seek(params: SeekParams, state: north_seek.State, seconds: float, bias: float = 0.0) -> None:
    clean = motion(seconds, 34.0 * DEG, 1.0, 0.5, still, 50.0)
    gyro, accel = felt(clean, np.random.default_rng(1), 0.02, 0.02, 30.0, np.full(3, bias) * DEG_H)
    north_seek.run(params, state, clean.stamp_ns, gyro, accel)


def test_it_starts_level_with_its_axis_north_and_every_azimuth_as_likely() -> None:
    params, state = SeekParams(), north_seek.initial()
    seek(params, state, 2.06)
    k = kernel_settings(params)
    mat = state.mat.reshape(3, 3)
    assert_allclose(mat @ mat.T, np.eye(3), atol=1e-12)
    assert_allclose(math.atan2(mat[1, 0], mat[0, 0]), 0.0, atol=1e-3)
    assert_allclose(math.acos(mat[2, 0]), 1.0, atol=1e-3)
    prior = state.P[EARTH : EARTH + 2, EARTH : EARTH + 2]
    assert_allclose(prior, np.eye(2) * (3.0 * k[K_HORIZONTAL]) ** 2, atol=1e-4 * k[K_HORIZONTAL] ** 2)
    assert_allclose(np.sqrt(np.diag(state.P)[BIAS : BIAS + 3]), [k[K_BX], k[K_B], k[K_B]], rtol=1e-3)


def test_a_seek_that_carries_on_keeps_the_instrument_and_forgets_the_hole() -> None:
    params, first = SeekParams(), north_seek.initial()
    seek(params, first, 20.0, 3.0)
    assert first.memory[PHASE] == SEEKING
    state = north_seek.carried_on(params, first, 0.0)
    assert state.memory[CARRIED] == 1.0
    seek(params, state, 2.06)
    instrument = [*range(BIAS, AXIS), LEAD]
    assert_array_equal(state.x[instrument], first.x[instrument])
    assert_allclose(state.P[np.ix_(instrument, instrument)], first.P[np.ix_(instrument, instrument)], rtol=1e-5)
    assert_array_equal(state.x[EARTH : EARTH + 2], 0.0)
    assert not state.P[np.ix_(instrument, range(EARTH, EARTH + 2))].any()


def test_a_silence_between_two_seeks_lets_the_biases_walk_and_one_that_found_nothing_starts_afresh() -> None:
    params, first = SeekParams(gyro_walk_deg_h_rth=2.0), north_seek.initial()
    seek(params, first, 20.0)
    later = north_seek.carried_on(params, first, 3600.0)
    grown = np.diag(later.P - first.P)[BIAS : BIAS + 3]
    assert_allclose(np.sqrt(grown) / DEG_H, 2.0, rtol=1e-9)
    assert north_seek.carried_on(params, north_seek.initial(), 1.0).memory[CARRIED] == 0.0


def test_the_frame_of_an_axis_is_its_high_and_right_side() -> None:
    memory = north_seek.initial().memory
    memory[2:5] = mat_nt(1.0, 0.5, 0.0)[:, 0]
    hx, hy, hz, rx, ry = frame(memory)
    assert_allclose([hx, hy, hz], mat_nt(1.0, 0.5, 0.0)[:, 2], atol=1e-12)
    assert_allclose([rx, ry, 0.0], -mat_nt(1.0, 0.5, 0.0)[:, 1], atol=1e-12)
    memory[2:5] = [0.0, 0.0, 1.0]
    assert_allclose(frame(memory), [-1.0, 0.0, 0.0, 0.0, 1.0], atol=0.0)


def test_one_call_is_many_calls() -> None:
    params = SeekParams()
    clean = motion(5.0, 34.0 * DEG, 1.0, 0.5, still, 50.0)
    states = [north_seek.initial(), north_seek.initial()]
    k = kernel_settings(params)
    for state, size in zip(states, (250, 1), strict=True):
        for i in range(0, 250, size):
            at = slice(i, i + size)
            advance(
                k, 10**9, state.clock, state.mat, state.x, state.P, state.sums, state.memory,
                clean.stamp_ns[at], clean.gyro_t[at], clean.accel_t[at],
            )  # fmt: skip
    assert_array_equal(states[0].x, states[1].x)
    assert_array_equal(states[0].P, states[1].P)
