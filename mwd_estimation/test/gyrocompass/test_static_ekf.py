# SPDX-License-Identifier: Apache-2.0
"""S1's 15-state north seeker: its limits, its sigma, its Jacobian and its refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from north_signals import measured, motion, still
from numpy.testing import assert_array_equal

from consistency import assert_consistent
from mwd_estimation.core.status import Status
from mwd_estimation.gyrocompass import static_ekf
from mwd_estimation.gyrocompass.static_ekf import Params
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE, MICRO_G
from mwd_sensors.core.frames import wrap_pi

DEG = math.radians(1.0)
GOOD = Params(latitude_deg=34.0, gyro_noise_deg_rth=0.05, gyro_bias_deg_h=0.05)


def monte_carlo(params: Params, seconds: float, runs: int, azimuth: float = 1.2, inclination: float = 1.1):
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
        north = static_ekf.run(params, static_ekf.initial(params), clean.stamp_ns, gyro, accel)
        errors[r], sigmas[r] = wrap_pi(north.azimuth[-1] - azimuth), north.sigma_azimuth[-1]
    return errors, sigmas


def limit(params: Params, seconds: float) -> float:
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
    north = static_ekf.run(GOOD, static_ekf.initial(GOOD), clean.stamp_ns, clean.gyro_t, clean.accel_t)
    assert np.isnan(north.azimuth[0])
    assert north.status[0] & Status.INITIALISING
    assert north.azimuth[-1] == pytest.approx(azimuth, abs=0.005 * DEG)
    assert north.inclination[-1] == pytest.approx(inclination, abs=0.005 * DEG)
    assert north.toolface[-1] == pytest.approx(0.4, abs=0.005 * DEG)


@pytest.mark.parametrize("latitude_deg", [0.0, -44.0, 60.0])
def test_error_and_sigma_keep_to_the_limit_of_the_noise(latitude_deg: float) -> None:
    params = Params(latitude_deg=latitude_deg, gyro_noise_deg_rth=0.05, gyro_bias_deg_h=0.05)
    errors, sigmas = monte_carlo(params, 60.0, 60)
    best = limit(params, 60.0)
    assert np.sqrt(np.mean(errors**2)) < 1.2 * best
    assert 0.9 * best < sigmas.mean() < 1.2 * best
    assert_consistent(errors, sigmas, confidence=0.95)


def test_an_unknown_bias_is_in_the_sigma_and_time_does_not_hide_it() -> None:
    params = Params(latitude_deg=34.0, gyro_noise_deg_rth=0.05, gyro_bias_deg_h=1.0)
    errors, sigmas = monte_carlo(params, 120.0, 60)
    # 4.6 deg of azimuth per deg/h at 34 deg latitude.
    assert sigmas.mean() == pytest.approx(limit(params, 120.0), rel=0.1)
    assert_consistent(errors, sigmas, confidence=0.95)


def test_blocks_of_any_length_and_a_resumed_state_give_the_same_bits() -> None:
    clean = motion(30.0, 34.0 * DEG, 1.0, 2.0, still, rate=50.0)
    gyro, accel = measured(clean, np.random.default_rng(1), 0.05, accel_noise_ug=30.0)
    whole_state = static_ekf.initial(GOOD)
    whole = static_ekf.run(GOOD, whole_state, clean.stamp_ns, gyro, accel)
    state = static_ekf.initial(GOOD)
    parts = []
    for a, b in [(0, 1), (1, 2), (2, 900), (900, 1100), (1100, 1500)]:
        state = state.copy()
        parts.append(static_ekf.run(GOOD, state, clean.stamp_ns[a:b], gyro[a:b], accel[a:b]))
    for name in ("azimuth", "inclination", "toolface", "sigma_azimuth", "sigma_inclination", "ratio", "status"):
        assert_array_equal(np.concatenate([getattr(p, name) for p in parts]), getattr(whole, name))
    assert state == whole_state


def test_a_tool_that_turns_is_not_called_still() -> None:
    moving = motion(60.0, 34.0 * DEG, 1.0, lambda t: 1.0 + 0.02 * np.sin(t), lambda t: 0.1 * t, rate=50.0)
    swinging = moving.accel_t + 0.3 * np.sin(np.arange(3000) / 8.0)[:, None]
    north = static_ekf.run(GOOD, static_ekf.initial(GOOD), moving.stamp_ns, moving.gyro_t, swinging)
    assert not north.status[-1] & Status.STILL
    assert north.ratio[-1] > GOOD.moved_ratio


def test_bad_samples_are_passed_over_and_a_gap_starts_anew() -> None:
    clean = motion(40.0, 34.0 * DEG, 1.0, 2.0, still, rate=50.0)
    gyro = clean.gyro_t.copy()
    gyro[1700] = np.nan
    stamps = clean.stamp_ns.copy()
    stamps[1900:] += 5 * 10**9
    north = static_ekf.run(GOOD, static_ekf.initial(GOOD), stamps, gyro, clean.accel_t)
    assert north.status[1700] & Status.REJECTED
    assert north.azimuth[1700] == north.azimuth[1699]
    assert north.azimuth[1899] == pytest.approx(2.0, abs=1e-3)
    assert north.status[1900] & Status.GAP
    assert np.isnan(north.azimuth[1900])


@pytest.mark.fault_case(33)
def test_above_85_degrees_of_latitude_the_filter_refuses_in_words() -> None:
    with pytest.raises(ValueError, match="too near the pole"):
        static_ekf.initial(Params(latitude_deg=-86.0))


def test_a_vertical_hole_is_flagged() -> None:
    clean = motion(30.0, 34.0 * DEG, 0.01, 1.0, still, rate=50.0)
    north = static_ekf.run(GOOD, static_ekf.initial(GOOD), clean.stamp_ns, clean.gyro_t, clean.accel_t)
    assert north.status[-1] & Status.NEAR_VERTICAL
