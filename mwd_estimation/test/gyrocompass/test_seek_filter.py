# SPDX-License-Identifier: Apache-2.0
"""The compiled filter of north seeking: its Jacobian, its start, and what it carries on."""

from __future__ import annotations

import math

import numpy as np
from north_signals import measured, motion, still
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from mwd_estimation.gyrocompass import north_seek, seek_filter
from mwd_estimation.gyrocompass.seek_filter import frame
from mwd_estimation.gyrocompass.seek_state import Error, SeekParams, SeekState, estimate, kernel_params
from mwd_sensors.core.constants import DEG_PER_HOUR
from mwd_sensors.core.frames import mat_nt

BIAS, EARTH = slice(Error.GYRO_BIAS, Error.SCALE_X), slice(Error.EARTH_RATE, Error.GYRO_BIAS)


def set_estimate(s: SeekState, x: np.ndarray) -> None:
    """The inverse of `estimate`."""
    s.velocity[:], s.earth_rate[:], s.gyro_bias[:] = x[3:5], x[5:8], x[8:11]
    s.scale_x, s.leak[:], s.g_sensitivity[:], s.lag, s.force_bias[:] = x[11], x[12:14], x[14:18], x[18], x[19:22]
    s.axis[:], s.roll, s.wobble[:], s.lead, s.bias_ramp[:] = x[22:24], x[24], x[25:33], x[33], x[34:37]


def test_the_estimate_in_the_order_of_the_errors_is_that_of_the_state() -> None:
    state, x = north_seek.initial(), np.arange(float(Error.SIZE))
    x[:3] = 0.0
    set_estimate(state, x)
    assert_array_equal(estimate(state), x)
    for name, at in (("earth_rate", Error.EARTH_RATE), ("force_bias", Error.FORCE_BIAS), ("wobble", Error.WOBBLE)):
        assert_array_equal(getattr(state, name), at + np.arange(len(getattr(state, name))))


def test_transition_is_the_derivative_of_the_integration() -> None:
    rng = np.random.default_rng(6)
    x = np.zeros(Error.SIZE)
    x[Error.EARTH_RATE : Error.AXIS] = rng.standard_normal(Error.AXIS - Error.EARTH_RATE) * 1e-3
    x[EARTH] = [0.006, -0.004, -0.005]
    x[Error.LAG] = 0.02
    mat = mat_nt(1.1, 0.3, 0.7)
    rates, forces = rng.standard_normal((10, 3)) * 0.3, rng.standard_normal((10, 3)) * 4.0
    rates[:, 0] += 3.0

    def after(error: np.ndarray) -> SeekState:
        state = north_seek.initial()
        set_estimate(state, x + error)
        state.mat[:] = Rotation.from_rotvec(error[:3]).as_matrix() @ mat
        for w, f in zip(rates, forces, strict=True):
            seek_filter.sample(state, np.zeros((3, 3)), 0.002, w, f)
        return state

    base = after(np.zeros(Error.SIZE))
    phi = np.zeros((5, Error.SIZE))
    start = base.copy()
    set_estimate(start, x)
    seek_filter.transition(start, phi)
    numeric, step = np.zeros((5, Error.SIZE)), 1e-5
    for j in [*range(Error.AXIS), Error.LEAD]:
        plus, minus = after(step * np.eye(Error.SIZE)[j]), after(-step * np.eye(Error.SIZE)[j])
        turned = [Rotation.from_matrix(s.mat @ base.mat.T).as_rotvec() for s in (plus, minus)]
        numeric[:3, j] = (turned[0] - turned[1]) / (2.0 * step)
        numeric[3:, j] = (plus.velocity - minus.velocity) / (2.0 * step)
    # The lag column holds for the Earth rate alone, not for these rates; that it works is shown with a lag in a seek.
    without_lag = [j for j in range(Error.SIZE) if j != Error.LAG]
    scale = np.maximum(np.abs(numeric).max(axis=0), 1e-3)
    assert_allclose((phi / scale)[:, without_lag], (numeric / scale)[:, without_lag], atol=0.05)


def seek(params: SeekParams, state: SeekState, seconds: float, bias: float = 0.0) -> None:
    clean = motion(seconds, 34.0 * math.radians(1.0), 1.0, 0.5, still, 50.0)
    gyro, accel = measured(clean, np.random.default_rng(1), 0.02, 0.02, 30.0, np.full(3, bias) * DEG_PER_HOUR)
    north_seek.run(params, state, clean.stamp_ns, gyro, accel)


def test_it_starts_level_with_its_axis_north_and_every_azimuth_as_likely() -> None:
    params, state = SeekParams(), north_seek.initial()
    seek(params, state, 2.06)
    p, mat = kernel_params(params), state.mat
    assert_allclose(mat @ mat.T, np.eye(3), atol=1e-12)
    assert_allclose(math.atan2(mat[1, 0], mat[0, 0]), 0.0, atol=1e-3)
    assert_allclose(math.acos(mat[2, 0]), 1.0, atol=1e-3)
    assert_allclose(state.P[EARTH, EARTH], np.eye(3) * (3.0 * p.horizontal) ** 2, atol=1e-4 * p.horizontal**2)
    assert_allclose(np.sqrt(np.diag(state.P)[BIAS]), p.start_bias, rtol=1e-3)


def test_the_frame_of_an_axis_is_its_high_and_right_side() -> None:
    mat = mat_nt(1.0, 0.5, 0.0)
    hx, hy, hz, rx, ry = frame(mat[:, 0].copy())
    assert_allclose([hx, hy, hz], mat[:, 2], atol=1e-12)
    assert_allclose([rx, ry, 0.0], -mat[:, 1], atol=1e-12)
    assert_allclose(frame(np.array([0.0, 0.0, 1.0])), [-1.0, 0.0, 0.0, 0.0, 1.0], atol=0.0)
