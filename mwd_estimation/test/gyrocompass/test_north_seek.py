# SPDX-License-Identifier: Apache-2.0
"""North seeking still, in two positions and turning: limits, honest sigma, what is observable and what is refused."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from north_signals import Motion, measured, motion, steady, still
from numpy.testing import assert_allclose, assert_array_equal

from consistency import assert_consistent
from mwd_estimation.core import clip_flags
from mwd_estimation.core.reason_text import text
from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.gyrocompass import gyro_errors, north_seek
from mwd_estimation.gyrocompass.seek_state import SeekParams, SeekState, white_noise, with_noise
from mwd_estimation.gyrocompass.solution import Solution
from mwd_sensors.core import earth
from mwd_sensors.core.constants import DEG_PER_HOUR, MICRO_G, STANDARD_GRAVITY
from mwd_sensors.core.frames import wrap_pi

DEG = math.radians(1.0)
RATE = 50.0
PRECISION_X = {"gyro_x_bias_deg_h": 0.01, "gyro_bias_deg_h": 0.01, "scale_x_ppm": 300.0}


def settings(mode: str, noise: float, latitude_deg: float, **more: object) -> SeekParams:
    x = {"gyro_x_noise_deg_rth": noise, **PRECISION_X} if mode == "still" else {}
    more = {"lead_sigma_ms": 0.05, **more}
    return SeekParams(
        mode=mode, gyro_noise_deg_rth=noise, latitude_deg=latitude_deg, gyro_walk_deg_h_rth=0.0, **x, **more
    )


# Runs that a rate of errors is estimated from: few in the gate, whose chi-square band is wider, many at night.
DRAWN = pytest.mark.parametrize("runs", [12, pytest.param(60, marks=pytest.mark.nightly)])

TACTICAL_AT_44 = settings("auto", 0.05, 44.0, gyro_bias_deg_h=5.0, gyro_x_bias_deg_h=5.0, g_sensitivity_deg_h_g=0.5)


def spin_up(rpm: float, wobble: float = 0.0) -> Callable[[np.ndarray], np.ndarray]:
    """At rest for 5 s, up to speed in 5 s, then steady with a once-per-turn wobble of the speed."""
    speed = rpm * math.tau / 60.0

    def roll(t: np.ndarray) -> np.ndarray:
        turned = speed * (np.clip(t - 5.0, 0.0, 5.0) ** 2 / 10.0 + np.clip(t - 10.0, 0.0, None))
        return np.asarray(0.4 + turned + wobble * np.sin(turned))

    return roll


def two_positions(t: np.ndarray) -> np.ndarray:
    """Half a turn in 6 s, half way through a minute."""
    return np.asarray(0.4 + math.pi * np.clip((t - 29.0) / 6.0, 0.0, 1.0))


def monte_carlo(
    params: SeekParams, clean: Motion, runs: int, seed: int = 5, **errors: float
) -> tuple[np.ndarray, np.ndarray, Solution]:
    """Errors and sigmas, rad, of `runs` runs with biases and errors drawn from the stated sigmas; the last answer."""
    rng = np.random.default_rng(seed)
    error, sigma = np.empty(runs), np.empty(runs)
    for r in range(runs):
        bias = rng.standard_normal(3) * DEG_PER_HOUR
        bias *= [params.gyro_x_bias_deg_h, params.gyro_bias_deg_h, params.gyro_bias_deg_h]
        gyro, accel = measured(
            clean,
            rng,
            params.gyro_noise_deg_rth,
            params.gyro_x_noise_deg_rth,
            params.accel_noise_ug_rthz,
            bias,
            rng.standard_normal(3) * params.accel_bias_ug * MICRO_G,
            scale_x=errors.get("scale_x", 0.0) * rng.standard_normal(),
            leak=errors.get("leak", 0.0) * rng.standard_normal(2),
        )
        state = north_seek.initial()
        north_seek.run(params, state, clean.stamp_ns, gyro, accel)
        found = north_seek.solution(params, state)
        error[r], sigma[r] = wrap_pi(found.azimuth - clean.azimuth[-1]), found.sigma
    return error, sigma, found


def assert_at_limit(error: np.ndarray, sigma: np.ndarray, limit: float) -> None:
    assert np.sqrt(np.mean(error**2)) < 1.2 * limit
    # Sigma also covers a latitude that is stated wrong.
    assert sigma.mean() < 1.25 * limit
    assert_consistent(error, sigma, confidence=0.99)


@pytest.mark.slow(1.5)
@DRAWN
@pytest.mark.parametrize(("noise", "latitude_deg"), [(0.003, 0.0), (0.15, -60.0)])
def test_a_still_tool_with_known_bias_reaches_the_noise_limit(noise: float, latitude_deg: float, runs: int) -> None:
    params = dataclasses.replace(
        settings("still", noise, latitude_deg), gyro_bias_deg_h=noise / 50.0, gyro_x_bias_deg_h=noise / 50.0
    )
    params = dataclasses.replace(params, accel_bias_ug=20.0)
    clean = motion(63.5, latitude_deg * DEG, 1.0, 1.2, still, RATE)
    error, sigma, found = monte_carlo(params, clean, runs)
    assert found.success, found.reason
    assert found.method == "still"
    assert_at_limit(error, sigma, found.limit)


@pytest.mark.slow
@DRAWN
@pytest.mark.parametrize(("noise", "latitude_deg"), [(0.003, 60.0), (0.15, 0.0)])
def test_a_turning_tool_reaches_the_limit_without_knowing_its_biases(
    noise: float, latitude_deg: float, runs: int
) -> None:
    params = dataclasses.replace(settings("rotating", noise, latitude_deg), accel_bias_ug=20.0)
    clean = motion(63.5, latitude_deg * DEG, 1.0, 0.5, steady(60.0), RATE)
    error, sigma, found = monte_carlo(params, clean, runs, scale_x=0.003)
    assert found.success, found.reason
    assert_at_limit(error, sigma, found.limit)


@pytest.mark.slow(1.5)
@DRAWN
def test_half_a_turn_cancels_a_bias_that_hides_north_from_a_still_tool(runs: int) -> None:
    params = settings("auto", 0.05, 34.0, gyro_bias_deg_h=10.0)
    flipped = motion(67.5, 34.0 * DEG, 1.0, 0.5, two_positions, RATE)
    error, sigma, found = monte_carlo(params, flipped, runs)
    assert found.method == "two_position"
    assert found.success, found.reason
    # The half turn itself shows little: the limit is that of the time at rest, 9 % less.
    assert_at_limit(error, sigma, 1.05 * found.limit)
    alone = motion(67.5, 34.0 * DEG, 1.0, 0.5, still, RATE)
    found = monte_carlo(params, alone, runs=1)[2]
    assert not found.success
    assert found.reason.code is ReasonCode.GYRO_BIAS_UNKNOWN
    assert "bias is known only to 10 deg/h" in text(found.reason)


@pytest.mark.slow(2)
@pytest.mark.parametrize("azimuth", [0.5, pytest.param(2.6, marks=pytest.mark.nightly)])
def test_a_bias_that_drifts_by_degrees_an_hour_within_a_minute_is_in_sigma_or_refused(azimuth: float) -> None:
    """A ramp two hundred times the stated one, either way on each axis, over two positions."""
    params = settings("auto", 0.05, 34.0, gyro_bias_deg_h=5.0, gyro_x_bias_deg_h=5.0, gyro_ramp_deg_h2=3.0)
    clean, rng = motion(67.5, 34.0 * DEG, 1.0, azimuth, two_positions, RATE), np.random.default_rng(36)
    hours, given = (clean.stamp_ns - clean.stamp_ns[0]) / 3.6e12, []
    for _ in range(15):
        gyro, accel = measured(
            clean, rng, 0.05, 0.05, params.accel_noise_ug_rthz, 5.0 * DEG_PER_HOUR * rng.normal(size=3)
        )
        ramp = 600.0 * DEG_PER_HOUR * rng.choice([-1.0, 1.0], 3)
        state = north_seek.initial()
        north_seek.run(params, state, clean.stamp_ns, gyro + hours[:, None] * ramp, accel)
        found = north_seek.solution(params, state)
        if found.success:
            given.append(abs(float(wrap_pi(found.azimuth - azimuth))) / found.sigma)
    assert len(given) > 5
    assert max(given) < 3.0


@pytest.mark.slow(4)
def test_a_unit_with_three_times_the_stated_g_sensitivity_stays_within_sigma() -> None:
    params = settings("auto", 0.05, 34.0, gyro_bias_deg_h=5.0, gyro_x_bias_deg_h=5.0, g_sensitivity_deg_h_g=0.5)
    clean, rng = motion(67.5, 34.0 * DEG, 1.0, 0.5, two_positions, RATE), np.random.default_rng(9)
    given = []
    for _ in range(30):
        matrix = 0.5 * 3.0 * rng.standard_normal((2, 2)) * DEG_PER_HOUR / STANDARD_GRAVITY
        bias = 5.0 * DEG_PER_HOUR * rng.standard_normal(3)
        gyro, accel = measured(clean, rng, 0.05, 0.05, params.accel_noise_ug_rthz, bias, g_sensitivity=matrix)
        state = north_seek.initial()
        north_seek.run(params, state, clean.stamp_ns, gyro, accel)
        found = north_seek.solution(params, state)
        if found.success:
            given.append(abs(float(wrap_pi(found.azimuth - 0.5))) / found.sigma)
    assert len(given) > 15
    # One in a hundred may be: with the stated g-sensitivity alone, five of these thirty are beyond 3 sigma.
    assert np.count_nonzero(np.array(given) > 3.0) <= 1


def tactical_seeks(latitude: float, told: float, inclination: float, azimuth: float, count: int) -> list[Solution]:
    """Results of seeks in two positions by a tactical unit that is as stated; angles in deg."""
    params = settings("auto", 0.05, told, gyro_bias_deg_h=5.0, gyro_x_bias_deg_h=5.0, g_sensitivity_deg_h_g=0.5)
    clean = motion(67.5, latitude * DEG, inclination * DEG, azimuth * DEG, two_positions, RATE)
    rng, found = np.random.default_rng(10), []
    for _ in range(count):
        matrix = 0.5 * rng.standard_normal((2, 2)) * DEG_PER_HOUR / STANDARD_GRAVITY
        bias = 5.0 * DEG_PER_HOUR * rng.standard_normal(3)
        of_force = {"accel_bias": 100.0 * MICRO_G * rng.standard_normal(3), "accel_scale": 3e-4 * rng.standard_normal()}
        gyro, accel = measured(clean, rng, 0.05, 0.05, 30.0, bias, g_sensitivity=matrix, **of_force)
        state = north_seek.initial()
        north_seek.run(params, state, clean.stamp_ns, gyro, accel)
        found.append(north_seek.solution(params, state))
    return found


@pytest.mark.slow(0.7)
@pytest.mark.parametrize(
    ("latitude", "inclination", "azimuth", "named"), [(55.0, 63.0, 273.0, True), (44.0, 47.0, 59.0, False)]
)
def test_a_wrong_latitude_is_named_or_in_sigma(
    latitude: float, inclination: float, azimuth: float, named: bool
) -> None:
    """Towards east or west azimuth and latitude, here told 15 deg wrong, explain the same rates; gravity does not."""
    found = tactical_seeks(latitude, latitude - 15.0, inclination, azimuth, 6)
    for one in found:
        if one.success:
            assert abs(wrap_pi(one.azimuth - azimuth * DEG)) < 3.0 * one.sigma
    assert not named or any(one.reason is not None and one.reason.code is ReasonCode.LATITUDE_OTHER for one in found)


def two_positions_at(height_m: float) -> SeekState:
    """State of a seek of a tactical unit at 44 deg, where gravity is the normal gravity at this height."""
    clean = motion(67.5, 44.0 * DEG, 1.0, 1.2, two_positions, RATE)
    scale = earth.gravity(44.0 * DEG, height_m) / earth.gravity(44.0 * DEG, 0.0) - 1.0
    gyro, accel = measured(clean, np.random.default_rng(12), 0.05, 0.05, 30.0, accel_scale=scale)
    state = north_seek.initial()
    north_seek.run(TACTICAL_AT_44, state, clean.stamp_ns, gyro, accel)
    return state


@pytest.mark.slow(0.2)
def test_a_right_latitude_keeps_its_sigma(monkeypatch: pytest.MonkeyPatch) -> None:
    state = two_positions_at(0.0)
    sigma = north_seek.solution(TACTICAL_AT_44, state).sigma
    monkeypatch.setattr(north_seek, "_WRONG", 1e-12)
    assert sigma == pytest.approx(north_seek.solution(TACTICAL_AT_44, state).sigma, rel=0.03)


@pytest.mark.slow(0.2)
def test_the_gravity_of_a_high_place_is_not_taken_for_another_latitude() -> None:
    at_sea = north_seek.solution(TACTICAL_AT_44, two_positions_at(0.0))
    high = north_seek.solution(dataclasses.replace(TACTICAL_AT_44, height_m=4000.0), two_positions_at(4000.0))
    assert high.sigma == pytest.approx(at_sea.sigma, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("most", [-0.02, pytest.param(0.03, marks=pytest.mark.nightly)])
def test_sigma_changes_continuously_as_gravity_speaks_for_another_latitude(most: float) -> None:
    state = two_positions_at(0.0)
    force, sigmas = state.down_force, []
    for off in np.arange(-0.03, most, 0.001):
        state.down_force = force - off * state.elapsed
        sigmas.append(north_seek.solution(TACTICAL_AT_44, state).sigma)
    assert max(sigmas) > 1.2 * min(sigmas)
    assert np.abs(np.diff(np.log(sigmas))).max() < 0.1


@pytest.mark.slow(0.2)
@pytest.mark.parametrize("off_mg", [-2.0, 2.0])
def test_accelerometers_far_off_do_not_make_a_right_latitude_wrong(off_mg: float) -> None:
    """Nobody states the accelerometers of a precision unit; 2 mg is 22 deg of latitude by normal gravity alone."""
    state = two_positions_at(0.0)
    state.down_force *= 1.0 + 1e-3 * off_mg
    found = north_seek.solution(TACTICAL_AT_44, state)
    assert found.success
    assert abs(wrap_pi(found.azimuth - 1.2)) < 3.0 * found.sigma


def test_the_other_hemisphere_is_refused() -> None:
    """Two positions near the horizontal: many wrong azimuths fit the wrong sign of the latitude."""
    params = settings("auto", 0.05, -34.0, gyro_bias_deg_h=5.0, gyro_x_bias_deg_h=5.0, g_sensitivity_deg_h_g=0.5)
    for azimuth in np.linspace(0.0, math.tau, 6, endpoint=False):
        clean = motion(67.5, 34.0 * DEG, 0.6, azimuth, two_positions, RATE)
        assert refusal(params, clean) in (ReasonCode.LATITUDE_OTHER, ReasonCode.LATITUDE_MISFIT)


@pytest.mark.slow(1.5)
@DRAWN
def test_x_leakage_times_speed_wobble_is_regressed_out(runs: int) -> None:
    # 500 urad of leakage and 1 % wobble at 60 r/min are 31 urad/s locked to the turn: half the Earth rate.
    params = settings("rotating", 0.01, 34.0)
    clean = motion(67.5, 34.0 * DEG, 1.0, 0.5, spin_up(60.0, 0.01), RATE)
    error, sigma, found = monte_carlo(params, clean, runs, leak=5e-4)
    assert_at_limit(error, sigma, 1.1 * found.limit)


@pytest.mark.slow(1.7)
def test_a_known_lag_of_one_millisecond_is_undone() -> None:
    clean = motion(123.5, 34.0 * DEG, 1.0, 0.5, steady(120.0), RATE, lag=0.001)
    given = settings("rotating", 0.003, 34.0, lag_ms=1.0, lag_sigma_ms=0.01)
    error, sigma, _ = monte_carlo(given, clean, runs=8)
    assert abs(error.mean()) < 0.05 * DEG
    without_lag = dataclasses.replace(given, lag_ms=0.0)
    error, sigma, _ = monte_carlo(without_lag, clean, runs=3)
    assert abs(error.mean()) > 0.4 * DEG
    honest = dataclasses.replace(given, lag_ms=0.0, lag_sigma_ms=1.0)
    error, sigma, _ = monte_carlo(honest, clean, runs=3)
    assert np.abs(error / sigma).max() < 3.0


def test_an_accelerometer_ahead_of_the_gyros_shows_in_the_spin_up() -> None:
    late = motion(67.5, 34.0 * DEG, 1.0, 0.5, lambda t: spin_up(60.0)(t - 0.002), RATE)
    now = motion(67.5, 34.0 * DEG, 1.0, 0.5, spin_up(60.0), RATE)
    clean = dataclasses.replace(late, accel_t=now.accel_t)
    params = settings("rotating", 0.01, 34.0, lead_sigma_ms=5.0)
    error, sigma, found = monte_carlo(params, clean, runs=10)
    assert found.success, found.reason
    assert np.abs(error / sigma).max() < 3.5
    assert np.sqrt(np.mean(error**2)) < 1.4 * found.limit


def test_g_sensitivity_is_admitted_and_taken_off_where_it_is_calibrated() -> None:
    g_matrix = np.array([[3.0, -1.5], [2.5, 4.0]]) * DEG_PER_HOUR / STANDARD_GRAVITY
    params = settings("rotating", 0.01, 34.0, g_sensitivity_deg_h_g=3.6)
    rng = np.random.default_rng(2)

    def shot(
        params: SeekParams, inclination: float, azimuth: float, seconds: float
    ) -> tuple[north_seek.SeekState, float]:
        clean = motion(seconds, 34.0 * DEG, inclination, azimuth, steady(60.0), RATE)
        gyro, accel = measured(clean, rng, 0.01, 0.42, 30.0, g_sensitivity=g_matrix)
        state = north_seek.initial()
        north_seek.run(params, state, clean.stamp_ns, gyro, accel)
        return state, float(wrap_pi(north_seek.solution(params, state).azimuth - azimuth))

    state, error = shot(params, 1.0, 0.5, 120.0)
    found = north_seek.solution(params, state)
    assert abs(error) > 5.0 * DEG
    assert abs(error) < 3.0 * found.sigma
    # Half the sum of the diagonal, half the difference across it, half their difference and their sum.
    known = dataclasses.replace(params, g_calibration_deg_h_g=(3.5, -2.0, -0.5, 0.5), g_sensitivity_deg_h_g=0.0)
    errors = [shot(known, 1.0, 0.5, 120.0) for _ in range(3)]
    sigma = north_seek.solution(known, errors[0][0]).sigma
    assert sigma < 1.6 * north_seek.solution(known, errors[0][0]).limit
    assert max(abs(e) for _, e in errors) < 3.0 * sigma


@pytest.mark.slow(1.6)
def test_a_wobbling_axis_costs_little_and_sigma_knows() -> None:
    def inclination(t: np.ndarray) -> np.ndarray:
        return np.asarray(1.0 + 0.005 * np.cos(steady(60.0)(t)))

    params = settings("rotating", 0.05, 34.0)
    clean = motion(63.5, 34.0 * DEG, inclination, 0.5, steady(60.0), RATE)
    rng = np.random.default_rng(1)
    errors, sigmas = [], []
    for _ in range(15):
        gyro, accel = measured(clean, rng, 0.05, 0.42, 30.0)
        state = north_seek.initial()
        north_seek.run(params, state, clean.stamp_ns, gyro, accel)
        found = north_seek.solution(params, state)
        errors.append(wrap_pi(found.azimuth - 0.5))
        sigmas.append(found.sigma)
    assert found.success, found.reason
    assert np.sqrt(np.mean(np.square(errors))) < 1.4 * found.limit
    assert np.mean(sigmas) < 1.2 * found.limit


def test_a_horizontal_hole_turned_about_its_axis_has_two_answers() -> None:
    params = settings("rotating", 0.05, 34.0)
    clean = motion(63.5, 34.0 * DEG, 0.5 * math.pi, 20.0 * DEG, steady(60.0), RATE)
    gyro, accel = measured(clean, np.random.default_rng(4), 0.05, 0.42, 30.0)
    state = north_seek.initial()
    north_seek.run(params, state, clean.stamp_ns, gyro, accel)
    found = north_seek.solution(params, state)
    assert not found.success
    assert found.reason.code is ReasonCode.TWO_AZIMUTHS_FIT_GYRO
    choices = sorted(found.choices)
    assert len(choices) == 2
    for (azimuth, sigma), true in zip(choices, (20.0, 160.0), strict=True):
        assert abs(wrap_pi(azimuth - true * DEG)) < 3.0 * sigma


def refusal(params: SeekParams, clean: Motion, clip: float = math.inf) -> ReasonCode:
    state = north_seek.initial()
    north_seek.run(params, state, clean.stamp_ns, np.clip(clean.gyro_t, -clip, clip), clean.accel_t)
    found = north_seek.solution(params, state)
    assert found.reason is not None
    return found.reason.code


def test_what_cannot_be_measured_is_refused_with_its_reason() -> None:
    lat = 34.0 * DEG
    still_hole, turning = motion(40.0, lat, 1.0, 1.0, still, RATE), motion(40.0, lat, 1.0, 1.0, steady(60.0), RATE)
    east_west = motion(40.0, lat, 0.5 * math.pi, 91.0 * DEG, steady(60.0), RATE)
    vertical = motion(40.0, lat, 0.01, 1.0, still, RATE)
    short = motion(12.0, lat, 1.0, 1.0, still, RATE)
    moved = motion(60.0, lat, 1.0, lambda t: 1.0 + 0.1 * np.clip((t - 30.0) / 2.0, 0.0, 1.0), still, RATE)
    quiet = settings("still", 0.05, 34.0)
    assert refusal(settings("still", 0.05, 86.0), short) is ReasonCode.LATITUDE_POLAR
    assert refusal(quiet, short) is ReasonCode.SEEK_TOO_SHORT
    assert refusal(quiet, turning) is ReasonCode.TURNED_AT_REST
    assert refusal(settings("rotating", 0.05, 34.0), still_hole) is ReasonCode.TURNED_TOO_LITTLE
    assert refusal(settings("two_position", 0.05, 34.0), still_hole) is ReasonCode.NO_SECOND_POSITION
    assert refusal(settings("rotating", 0.05, 34.0), east_west) is ReasonCode.EAST_WEST_HOLE
    assert refusal(quiet, vertical) is ReasonCode.VERTICAL_HOLE
    assert refusal(quiet, moved) is ReasonCode.HOLE_AXIS_MOVED
    assert refusal(settings("auto", 0.05, 34.0, gyro_range_dps=1.0), moved, 0.0174) is ReasonCode.GYRO_CLIPPED
    assert refusal(dataclasses.replace(quiet, latitude_deg=80.0), still_hole) is ReasonCode.LATITUDE_MISFIT


@pytest.mark.slow(3)
def test_flags_say_what_a_clipped_sample_hides_of_north_and_too_many_of_them_refuse_it() -> None:
    params = settings("still", 0.05, 34.0, gyro_range_dps=50.0)
    clean = motion(63.5, 34.0 * DEG, 1.0, 1.2, still, RATE)
    flags = np.zeros(len(clean.stamp_ns), np.uint8)
    flags[[1200, 2100]] = clip_flags.CROSS_GYRO
    rng = np.random.default_rng(11)

    def sought(given: np.ndarray | None) -> tuple[float, float]:
        bias = rng.standard_normal(3) * 0.01 * DEG_PER_HOUR
        gyro, accel = measured(clean, rng, 0.05, 0.05, params.accel_noise_ug_rthz, bias, np.zeros(3))
        # The mean of a sample within which the range was passed misses a rate as large as the range.
        gyro[flags != 0, 1:] += 50.0 * DEG * rng.standard_normal((2, 2))
        state = north_seek.initial()
        north_seek.run(params, state, clean.stamp_ns, gyro, accel, given)
        found = north_seek.solution(params, state)
        return float(wrap_pi(found.azimuth - 1.2)), found.sigma

    error, sigma = np.transpose([sought(None) for _ in range(5)])
    assert np.mean((error / sigma) ** 2) > 5.0
    assert_consistent(*np.transpose([sought(flags) for _ in range(20)]))
    flags[::500] = clip_flags.AXIAL_GYRO
    state = north_seek.initial()
    north_seek.run(params, state, clean.stamp_ns, clean.gyro_t, clean.accel_t, flags)
    reason = north_seek.solution(params, state).reason
    assert reason is not None
    assert reason.code is ReasonCode.GYRO_CLIPPED
    assert "a gyro clipped" in text(reason)


def test_blocks_of_any_length_and_a_resumed_state_give_the_same_bits() -> None:
    params = settings("rotating", 0.05, 34.0)
    clean = motion(12.0, 34.0 * DEG, 1.0, 0.5, steady(60.0), RATE)
    gyro, accel = measured(clean, np.random.default_rng(1), 0.05, 0.42, 30.0)
    whole = north_seek.initial()
    north_seek.run(params, whole, clean.stamp_ns, gyro, accel)
    parts = north_seek.initial()
    for a, b in [(0, 1), (1, 97), (97, 98), (98, 600)]:
        parts = parts.copy()
        north_seek.run(params, parts, clean.stamp_ns[a:b], gyro[a:b], accel[a:b])
    assert parts == whole


def test_bad_samples_are_passed_over_and_a_gap_begins_anew() -> None:
    params = settings("still", 0.05, 34.0)
    clean = motion(80.0, 34.0 * DEG, 1.0, 0.5, still, RATE)
    gyro, stamps = clean.gyro_t.copy(), clean.stamp_ns.copy()
    gyro[500] = np.inf
    stamps[2000:] += 10 * 10**9
    state = north_seek.initial()
    north_seek.run(params, state, stamps, gyro, clean.accel_t)
    found = north_seek.solution(params, state)
    assert found.success, found.reason
    assert found.elapsed < 40.0
    assert found.azimuth == pytest.approx(0.5, abs=0.2 * found.sigma)


def test_the_conventional_x_gyro_stands_in_for_a_precision_x_gyro_that_clips() -> None:
    stamps = np.arange(10) * 10**7
    precision = np.full((10, 3), 7.0)
    ahrs = np.stack([np.linspace(16.0, 17.0, 10), np.zeros(10), np.zeros(10)], axis=-1)
    merged = north_seek.dual_unit(stamps, precision, stamps + 5 * 10**6, ahrs, 7.0)
    assert_allclose(merged[1:, 0], ahrs[1:, 0] - 0.5 / 9.0)
    assert_array_equal(merged[:, 1:], precision[:, 1:])
    slow = np.full((10, 3), 0.1)
    assert_array_equal(north_seek.dual_unit(stamps, slow, stamps, 0.0 * ahrs, 7.0), slow)
    with pytest.raises(ValueError, match="no sample"):
        north_seek.dual_unit(stamps, precision, [], np.zeros((0, 3)), 7.0)


def test_a_gyro_far_from_its_statement_is_named() -> None:
    clean = motion(40.0, 34.0 * DEG, 1.0, 1.0, still, RATE)
    params, state = settings("still", 0.05, 34.0), north_seek.initial()
    gyro = clean.gyro_t + np.array([30.0, 0.0, 0.0]) * DEG_PER_HOUR
    north_seek.run(params, state, clean.stamp_ns, gyro, clean.accel_t)
    found = north_seek.solution(params, state)
    assert not found.success
    assert found.reason.code in (ReasonCode.GYRO_BIAS_EXCESSIVE, ReasonCode.LATITUDE_MISFIT)


def test_a_bias_that_was_zeroed_may_have_walked_since() -> None:
    clean = motion(60.0, 34.0 * DEG, 1.0, 1.0, still, RATE)
    zeroed = {"gyro_bias_deg_h": 0.0, "gyro_x_bias_deg_h": 0.0, "gyro_walk_deg_h_rth": 0.3}
    params, state = dataclasses.replace(settings("still", 0.05, 34.0), **zeroed), north_seek.initial()
    north_seek.run(params, state, clean.stamp_ns, clean.gyro_t + 0.2 * DEG_PER_HOUR, clean.accel_t)
    found = north_seek.solution(params, state)
    assert found.success, found.reason
    assert abs(wrap_pi(found.azimuth - 1.0)) < 3.0 * found.sigma


@pytest.mark.slow(4)
@pytest.mark.fault_case(9)
@DRAWN
def test_a_gyro_whose_bias_drifts_to_the_next_station_errs_by_its_sigma_there(runs: int) -> None:
    rng, latitude, between = np.random.default_rng(8), math.radians(34.0), 1800.0
    params = SeekParams(
        gyro_x_noise_deg_rth=0.05, gyro_x_bias_deg_h=1.0, scale_x_ppm=300.0, accel_bias_ug=20.0, gyro_ramp_deg_h2=3.0
    )
    first = motion(66.0, latitude, math.radians(60.0), math.radians(40.0), two_positions, RATE)
    second = motion(60.0, latitude, math.radians(60.0), math.radians(70.0), still, RATE)
    error, sigma = np.empty(runs), np.empty(runs)
    for r in range(runs):
        bias, ramp = rng.standard_normal((2, 3)) * [[1.0], [3.0]] * DEG_PER_HOUR
        errors = None
        for clean, hours in ((first, 0.0), (second, between / 3600.0)):
            since = hours + (clean.stamp_ns - clean.stamp_ns[0])[:, None] / 3.6e12
            gyro, accel = measured(clean, rng, 0.05, None, 30.0)
            state = north_seek.initial()
            north_seek.run(params, state, clean.stamp_ns, gyro + bias + ramp * since, accel)
            found = north_seek.solution(params, state, errors)
            errors = gyro_errors.after(north_seek.learnt(params, state, errors), params, between)
        error[r], sigma[r] = wrap_pi(found.azimuth - math.radians(70.0)), found.sigma
    assert_consistent(error, sigma)


@pytest.mark.slow(2.8)
@pytest.mark.parametrize("runs", [24, pytest.param(100, marks=pytest.mark.nightly)])
def test_a_gyro_as_bad_as_the_bound_of_its_bias_errs_by_its_sigma_in_one_position(runs: int) -> None:
    params = SeekParams(
        latitude_deg=10.0,
        gyro_noise_deg_rth=0.05,
        gyro_x_noise_deg_rth=0.05,
        gyro_bias_deg_h=2.5,
        gyro_x_bias_deg_h=2.5,
        scale_x_ppm=300.0,
    )
    clean = motion(60.0, math.radians(10.0), math.radians(60.0), math.radians(40.0), still, RATE)
    error, sigma, last = monte_carlo(params, clean, runs)
    assert last.success
    assert_consistent(error, sigma)


def test_a_seek_teaches_where_the_tool_lies_otherwise_and_has_not_moved() -> None:
    params = settings("auto", 0.05, 34.0)

    def sought(toolface: float, roll: Callable[[np.ndarray], np.ndarray] = still) -> SeekState:
        clean = motion(66.0, 34.0 * DEG, 1.0, 1.2, lambda t: roll(t) + toolface, RATE)
        state = north_seek.initial()
        north_seek.run(params, state, clean.stamp_ns, clean.gyro_t, clean.accel_t)
        return state

    first = sought(0.0)
    assert north_seek.teaches(params, first, None)
    assert not north_seek.teaches(params, sought(10.0 * DEG), first)
    assert north_seek.teaches(params, sought(20.0 * DEG), first)
    assert north_seek.teaches(params, sought(0.0, two_positions), first)
    swayed = first.copy()
    swayed.scatter[:] = (1.0 * DEG) ** 2
    assert not north_seek.teaches(params, swayed, None)
    assert not north_seek.teaches(params, north_seek.initial(), None)


@pytest.mark.parametrize(("stated", "measured", "used"), [(0.05, 0.2, 0.2), (0.05, 0.055, 0.05), (0.0, 0.03, 0.03)])
def test_noise_that_the_samples_show_to_be_larger_replaces_the_stated_one(
    stated: float, measured: float, used: float
) -> None:
    params = with_noise(SeekParams(gyro_noise_deg_rth=stated), measured)
    assert (params.gyro_noise_deg_rth, params.gyro_x_noise_deg_rth) == (used, used)


@pytest.mark.parametrize("noise", [0.02, 0.2])
@pytest.mark.parametrize("turning", [False, True])
def test_noise_is_measured_at_rest_and_while_the_tool_turns(noise: float, turning: bool) -> None:
    clean = motion(8.0, 34.0 * DEG, 1.0, 0.5, steady(60.0) if turning else still, 100.0)
    gyro, _ = measured(clean, np.random.default_rng(6), noise, leak=np.array([3e-4, -3e-4]))
    assert white_noise(clean.stamp_ns, gyro) == pytest.approx(noise, rel=0.15)


@pytest.mark.parametrize("hertz", [0.05, 0.15, 0.5])
def test_a_sway_of_the_string_stays_within_sigma(hertz: float) -> None:
    params = settings("still", 0.01, 34.0, accel_bias_ug=20.0)
    rng = np.random.default_rng(8)
    for phase in rng.uniform(0.0, math.tau, 4):

        def swaying(t: np.ndarray, middle: float = 1.0, phase: float = phase) -> np.ndarray:
            return np.asarray(middle + 0.04 * DEG * np.sin(math.tau * hertz * t + phase))

        clean = motion(67.5, 34.0 * DEG, swaying, lambda t: swaying(t + 1.0, 1.2), still, RATE)
        gyro, accel = measured(clean, rng, 0.01, 0.01, 30.0)
        state = north_seek.initial()
        north_seek.run(params, state, clean.stamp_ns, gyro, accel)
        found = north_seek.solution(params, state)
        assert abs(wrap_pi(found.azimuth - 1.2)) < 3.0 * found.sigma
