"""S1's 15-state north seeker: its limits, its sigma, its Jacobian and its refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from north_signals import G0, felt, motion, still
from numpy.testing import assert_array_equal
from scipy.spatial.transform import Rotation

from mwd_estimation.core.status import Status
from mwd_estimation.gyrocompass import static_ekf
from mwd_estimation.gyrocompass.static_ekf import ATTITUDE, MATRIX, N_GYRO_BIAS, Params
from mwd_sensors.core.constants import DEG_PER_HOUR, DEG_PER_ROOT_HOUR, EARTH_RATE
from mwd_sensors.core.frames import mat_nt, wrap_pi

DEG = math.radians(1.0)
GOOD = Params(latitude_deg=34.0, gyro_noise_deg_rth=0.05, gyro_bias_deg_h=0.05)


def monte_carlo(params: Params, seconds: float, runs: int, azimuth: float = 1.2, inclination: float = 1.1):
    """Azimuth errors and sigmas at the end of `runs` noisy runs, rad."""
    clean = motion(seconds, math.radians(params.latitude_deg), inclination, azimuth, still, rate=50.0)
    rng = np.random.default_rng(7)
    errors, sigmas = np.empty(runs), np.empty(runs)
    for r in range(runs):
        gyro, accel = felt(
            clean,
            rng,
            params.gyro_noise_deg_rth,
            accel_noise_ug=params.accel_noise_ug_rthz,
            bias=rng.standard_normal(3) * params.gyro_bias_deg_h * DEG_PER_HOUR,
            accel_bias=rng.standard_normal(3) * params.accel_bias_ug * 1e-6 * G0,
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
    # Chi-square with 60 degrees of freedom: 95 % band 0.675 to 1.388.
    assert 0.675 < np.mean((errors / sigmas) ** 2) < 1.388


def test_an_unknown_bias_is_in_the_sigma_and_time_does_not_hide_it() -> None:
    params = Params(latitude_deg=34.0, gyro_noise_deg_rth=0.05, gyro_bias_deg_h=1.0)
    errors, sigmas = monte_carlo(params, 120.0, 60)
    # 4.6 deg of azimuth per deg/h at 34 deg latitude.
    assert sigmas.mean() == pytest.approx(limit(params, 120.0), rel=0.1)
    assert 0.675 < np.mean((errors / sigmas) ** 2) < 1.388


def test_transition_is_the_derivative_of_the_mechanisation() -> None:
    rng = np.random.default_rng(3)
    k, dt = static_ekf.kernel_settings(GOOD), 0.01
    x = np.zeros(static_ekf.NOMINAL)
    x[:6] = rng.standard_normal(6) * 0.1
    x[MATRIX : MATRIX + 9] = mat_nt(1.0, 2.0, 0.5).ravel()
    x[N_GYRO_BIAS : N_GYRO_BIAS + 6] = rng.standard_normal(6) * 1e-3
    # Times 1000, the Earth rate is large enough to be seen in a difference quotient.
    k[static_ekf.K_NORTH] *= 1e3
    k[static_ekf.K_DOWN] *= 1e3
    w, f = rng.standard_normal(3) * 0.02, np.array([-3.0, 4.0, 8.0])

    def moved(error: np.ndarray) -> np.ndarray:
        y = x.copy()
        y[:6] += error[:6]
        static_ekf.rotate_by(y, MATRIX, True, *error[ATTITUDE : ATTITUDE + 3])
        y[N_GYRO_BIAS : N_GYRO_BIAS + 6] += error[9:]
        static_ekf.propagate(y, k, dt, *w, *f)
        return y

    phi = np.zeros((9, 15))
    static_ekf.transition(x, MATRIX, k, dt, *(f - x[N_GYRO_BIAS + 3 : N_GYRO_BIAS + 6]), phi)
    base, step, numeric = moved(np.zeros(15)), 1e-5, np.zeros((9, 15))
    mat = base[MATRIX : MATRIX + 9].reshape(3, 3)
    for j in range(15):
        plus, minus = moved(step * np.eye(15)[j]), moved(-step * np.eye(15)[j])
        numeric[:6, j] = (plus[:6] - minus[:6]) / (2.0 * step)
        turned = [Rotation.from_matrix(y[MATRIX : MATRIX + 9].reshape(3, 3) @ mat.T).as_rotvec() for y in (plus, minus)]
        numeric[6:, j] = (turned[0] - turned[1]) / (2.0 * step)
    # I + F T leaves out terms of second order in T: (rate T) T, 1e-5 here.
    np.testing.assert_allclose(phi, numeric, atol=2e-5)


def test_blocks_of_any_length_and_a_resumed_state_give_the_same_bits() -> None:
    clean = motion(30.0, 34.0 * DEG, 1.0, 2.0, still, rate=50.0)
    gyro, accel = felt(clean, np.random.default_rng(1), 0.05, accel_noise_ug=30.0)
    whole_state = static_ekf.initial(GOOD)
    whole = static_ekf.run(GOOD, whole_state, clean.stamp_ns, gyro, accel)
    state = static_ekf.initial(GOOD)
    parts = []
    for a, b in [(0, 1), (1, 2), (2, 900), (900, 1100), (1100, 1500)]:
        state = state.copy()
        parts.append(static_ekf.run(GOOD, state, clean.stamp_ns[a:b], gyro[a:b], accel[a:b]))
    for name in ("azimuth", "inclination", "toolface", "sigma_azimuth", "sigma_inclination", "ratio", "status"):
        assert_array_equal(np.concatenate([getattr(p, name) for p in parts]), getattr(whole, name))
    assert_array_equal(state.P, whole_state.P)


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


def test_above_85_degrees_of_latitude_the_filter_refuses_in_words() -> None:
    with pytest.raises(ValueError, match="too near the pole"):
        static_ekf.initial(Params(latitude_deg=-86.0))


def test_a_vertical_hole_is_flagged() -> None:
    clean = motion(30.0, 34.0 * DEG, 0.01, 1.0, still, rate=50.0)
    north = static_ekf.run(GOOD, static_ekf.initial(GOOD), clean.stamp_ns, clean.gyro_t, clean.accel_t)
    assert north.status[-1] & Status.NEAR_VERTICAL


def test_covariance_is_carried_as_by_the_whole_transition() -> None:
    rng = np.random.default_rng(3)
    phi = rng.standard_normal((4, 7)) * (rng.random((4, 7)) < 0.5)
    whole = np.eye(7)
    whole[:4] = phi
    root = rng.standard_normal((7, 7))
    P = root @ root.T
    expected = whole @ P @ whole.T
    static_ekf.carry_covariance(P, phi, np.empty((4, 7)))
    np.testing.assert_allclose(P, expected, atol=1e-12)
