# SPDX-License-Identifier: Apache-2.0
"""S1's 15-state north seeker: its limits, its sigma, its Jacobian, and what starts it anew."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from north_signals import measured, motion, still
from scipy.spatial.transform import Rotation

from consistency import assert_consistent
from mwd_estimation.gyrocompass import static_ekf
from mwd_estimation.gyrocompass.seek_state import SeekParams, kernel_params
from mwd_estimation.gyrocompass.static_ekf import Error, StaticNorth, StaticState
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G
from mwd_sensors.core.frames import mat_nt, wrap_pi

DEG = math.radians(1.0)
# The coarse alignment takes 20 s.
GOOD = SeekParams(shortest=40.0, gyro_noise_deg_rth=0.05, gyro_bias_deg_h=0.05, gyro_walk_deg_h_rth=0.0)


ADDED = {
    "position": Error.POSITION,
    "velocity": Error.VELOCITY,
    "gyro_bias": Error.GYRO_BIAS,
    "accel_bias": Error.ACCEL_BIAS,
}


def sought(params: SeekParams, stamps, gyro, accel) -> tuple[StaticNorth, StaticState]:
    """What the filter finds in these samples, and its state."""
    state = static_ekf.initial()
    static_ekf.run(params, state, stamps, gyro, accel)
    return static_ekf.north(state), state


def monte_carlo(params: SeekParams, seconds: float, runs: int, azimuth: float = 1.2, inclination: float = 1.1):
    """Azimuth errors and sigmas at the end of `runs` noisy runs, rad."""
    clean = motion(seconds, math.radians(params.latitude_deg), inclination, azimuth, still, rate=50.0)
    rng = np.random.default_rng(7)
    errors, sigmas = np.empty(runs), np.empty(runs)
    for r in range(runs):
        gyro, accel = measured(
            clean,
            rng,
            params.gyro_noise_deg_rth,
            accel_noise_ug=params.accel_noise_ug_rthz,
            bias=rng.standard_normal(3) * params.gyro_bias_deg_h * DEG_PER_HOUR,
            accel_bias=rng.standard_normal(3) * params.accel_bias_ug * MICRO_G,
        )
        north, _ = sought(params, clean.stamp_ns, gyro, accel)
        errors[r], sigmas[r] = wrap_pi(north.azimuth - azimuth), north.sigma
    return errors, sigmas


def limit(params: SeekParams, seconds: float) -> float:
    """Bias known to its prior, white noise averaged: what no filter of a still tool can beat, rad."""
    rate = EARTH_RATE * math.cos(math.radians(params.latitude_deg))
    noise = params.gyro_noise_deg_rth * DEG_PER_ROOT_HOUR / math.sqrt(seconds)
    return math.hypot(noise, params.gyro_bias_deg_h * DEG_PER_HOUR) / rate


@pytest.mark.parametrize(
    ("dip_deg", "azimuth_deg"), [(19.74, 159.42), (20.81, 161.53), (22.28, 163.17), (-40.0, 301.0)]
)
def test_an_errorless_gyro_finds_the_azimuths_of_s1_table_1(dip_deg: float, azimuth_deg: float) -> None:
    inclination, azimuth = (90.0 - dip_deg) * DEG, azimuth_deg * DEG
    clean = motion(60.0, 34.0 * DEG, inclination, azimuth, still, rate=50.0)
    north, _ = sought(GOOD, clean.stamp_ns, clean.gyro_t, clean.accel_t)
    assert north.azimuth == pytest.approx(azimuth, abs=0.005 * DEG)
    assert north.inclination == pytest.approx(inclination, abs=0.005 * DEG)
    assert north.toolface == pytest.approx(0.4, abs=0.005 * DEG)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("latitude_deg", "bias", "seconds"),
    [(0.0, 0.05, 60.0), (-44.0, 0.05, 60.0), (60.0, 0.05, 60.0), (34.0, 1.0, 120.0)],
)
def test_error_and_sigma_keep_to_the_limit_of_the_noise_and_of_an_unknown_bias(latitude_deg, bias, seconds) -> None:
    params = dataclasses.replace(GOOD, latitude_deg=latitude_deg, gyro_bias_deg_h=bias)
    errors, sigmas = monte_carlo(params, seconds, 60)
    best = limit(params, seconds)
    assert np.sqrt(np.mean(errors**2)) < 1.2 * best
    assert 0.9 * best < sigmas.mean() < 1.2 * best
    assert_consistent(errors, sigmas, confidence=0.95)


def test_blocks_of_any_length_and_a_resumed_state_give_the_same_bits() -> None:
    clean = motion(30.0, 34.0 * DEG, 1.0, 2.0, still, rate=50.0)
    gyro, accel = measured(clean, np.random.default_rng(1), 0.05, accel_noise_ug=30.0)
    _, whole = sought(GOOD, clean.stamp_ns, gyro, accel)
    state = static_ekf.initial()
    for a, b in [(0, 1), (1, 2), (2, 900), (900, 1100), (1100, 1500)]:
        state = state.copy()
        static_ekf.run(GOOD, state, clean.stamp_ns[a:b], gyro[a:b], accel[a:b])
    assert state == whole


def test_a_tool_that_turns_is_not_called_still() -> None:
    moving = motion(60.0, 34.0 * DEG, 1.0, lambda t: 1.0 + 0.02 * np.sin(t), lambda t: 0.1 * t, rate=50.0)
    swinging = moving.accel_t + 0.3 * np.sin(np.arange(3000) / 8.0)[:, None]
    _, state = sought(GOOD, moving.stamp_ns, moving.gyro_t, swinging)
    assert state.ratio > static_ekf.MOVED_RATIO


def test_bad_samples_are_passed_over_and_a_gap_starts_anew() -> None:
    clean = motion(40.0, 34.0 * DEG, 1.0, 2.0, still, rate=50.0)
    gyro = clean.gyro_t.copy()
    gyro[1700] = np.nan
    stamps = clean.stamp_ns.copy()
    stamps[1900:] += 5 * 10**9

    def after(samples: int) -> StaticNorth:
        return sought(GOOD, stamps[:samples], gyro[:samples], clean.accel_t[:samples])[0]

    assert math.isnan(after(900).azimuth)
    assert after(1701) == after(1700)
    assert after(1900).azimuth == pytest.approx(2.0, abs=1e-3)
    assert math.isnan(after(1901).azimuth)


def test_transition_is_the_derivative_of_the_mechanisation() -> None:
    rng = np.random.default_rng(3)
    p, dt = kernel_params(GOOD), 0.01
    # Times 1000, the Earth rate is large enough to be seen in a difference quotient.
    p = p._replace(horizontal=1e3 * p.horizontal, down=1e3 * p.down)
    state = static_ekf.initial()
    state.position[:], state.velocity[:] = rng.standard_normal((2, 3)) * 0.1
    state.mat[:] = mat_nt(1.0, 2.0, 0.5)
    state.gyro_bias[:], state.accel_bias[:] = rng.standard_normal((2, 3)) * 1e-3
    rate, force = rng.standard_normal(3) * 0.02, np.array([-3.0, 4.0, 8.0])

    def moved(error: np.ndarray):
        s = state.copy()
        for name, at in ADDED.items():
            getattr(s, name)[:] += error[at : at + 3]
        s.mat[:] = Rotation.from_rotvec(error[Error.ATTITUDE : Error.ATTITUDE + 3]).as_matrix() @ s.mat
        static_ekf.propagate(p, s, dt, rate, force)
        return s

    phi = np.zeros((9, Error.SIZE))
    static_ekf.transition(p, state.mat, dt, *(force - state.accel_bias), phi)
    base, step, numeric = moved(np.zeros(Error.SIZE)), 1e-5, np.zeros((9, Error.SIZE))
    for j in range(Error.SIZE):
        plus, minus = moved(step * np.eye(Error.SIZE)[j]), moved(-step * np.eye(Error.SIZE)[j])
        numeric[:3, j] = (plus.position - minus.position) / (2.0 * step)
        numeric[3:6, j] = (plus.velocity - minus.velocity) / (2.0 * step)
        turned = [Rotation.from_matrix(s.mat @ base.mat.T).as_rotvec() for s in (plus, minus)]
        numeric[6:, j] = (turned[0] - turned[1]) / (2.0 * step)
    # I + F T leaves out terms of second order in T: (rate T) T, 1e-5 here.
    np.testing.assert_allclose(phi, numeric, atol=2e-5)
