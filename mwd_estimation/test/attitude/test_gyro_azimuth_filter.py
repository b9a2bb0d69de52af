# SPDX-License-Identifier: Apache-2.0
"""The filter of the gyro-propagated azimuth: its slopes, and a station's azimuth that no magnetic azimuth moves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mwd_estimation.attitude import gyro_azimuth_filter
from mwd_estimation.attitude.block import StationAzimuth
from mwd_estimation.attitude.gyro_azimuth_filter import (
    BIN_SUMS,
    MAGNETIC_AZIMUTH,
    STATES,
    Error,
    GyroAzimuthParams,
    at_latitude,
    gyro_unit,
    initial,
)
from mwd_estimation.gravity.bounded.jumps import BIAS_STEP
from mwd_sensors.core.frames import wrap_pi

PARAMS = at_latitude(
    GyroAzimuthParams(units=(gyro_unit(0.05, 2.0, 10.0, 1000.0, 3.6, 0.5), gyro_unit(0.05, 5.0, 0.3))), 60.0
)


def state_of(x=None, P=None):
    """A state with these Kalman states and covariance."""
    s = initial()[0]
    s.x[:] = 0.0 if x is None else x
    s.P[:] = 0.0 if P is None else P
    return s


def sums_of(**values):
    """Sums of a bin."""
    sums = np.zeros(1, dtype=BIN_SUMS)
    for name, value in values.items():
        sums[name] = value
    return sums[0]


def measured(slow=0.0, held=0.0, noise=0.0, usable=True):
    """A magnetic azimuth with these sigmas, rad."""
    row = np.zeros(1, dtype=MAGNETIC_AZIMUTH)
    row["sigma_slow"], row["sigma_held"], row["sigma_noise"], row["usable"] = slow, held, noise, usable
    return row[0]


@pytest.mark.parametrize("unit", [0, 1])
def test_propagation_is_the_derivative_of_itself(unit: int) -> None:
    quiet = tuple(one._replace(noise=0.0, walk=0.0) for one in PARAMS.units)
    p = PARAMS._replace(earth_north=1e3 * PARAMS.earth_north, units=quiet)
    sums = sums_of(
        turn=0.02, across=(0.3, -0.4), time=0.5, earth=0.6, leakage=(0.7, -0.2), spin=6.0, rate=(0.01, 0.02), lag=-0.3
    )
    x = np.array([2.0, 1.2, 0.7, -0.3, 1e-3, -2e-3, 3e-3, 1e-3, 1e-4, 2e-4, -3e-4, 1e-4, 1e-5, 2e-5, 1e-3, 2e-3])
    F = np.zeros((STATES, STATES))
    for j in range(STATES):
        ends = []
        for sign in (1.0, -1.0):
            s = state_of(x + sign * 1e-6 * np.eye(STATES)[j])
            gyro_azimuth_filter.propagate(p, s, sums, unit)
            ends.append(s.x.copy())
        F[:, j] = (ends[0] - ends[1]) / 2e-6
    root = np.random.default_rng(8).standard_normal((STATES, STATES))
    P = root @ root.T
    P[Error.SLOW_ERROR, Error.SLOW_ERROR] += 2.0
    expected = F @ P @ F.T
    expected[Error.SLOW_ERROR, Error.SLOW_ERROR] += 1.0 - F[Error.SLOW_ERROR, Error.SLOW_ERROR] ** 2
    s = state_of(x, P)
    gyro_azimuth_filter.propagate(p, s, sums, unit)
    assert_allclose(s.P, expected, rtol=1e-6, atol=1e-9)
    assert abs(F[Error.AZIMUTH, Error.AZIMUTH] - 1.0) > 1e-3
    assert abs(F[Error.STATION, Error.STATION] - F[Error.AZIMUTH, Error.AZIMUTH]) > 1e-4


def test_noise_moves_the_azimuth_and_that_of_the_station_together() -> None:
    s = state_of()
    gyro_azimuth_filter.propagate(PARAMS, s, sums_of(time=0.5, noise=1.0), 0)
    noise = PARAMS.units[0].noise ** 2
    assert noise > 0.0
    assert_allclose(s.P[:2, :2], noise, rtol=1e-12)


def test_a_sigma_that_varies_with_the_noise_neither_averages_its_error_down_nor_moves_the_azimuth() -> None:
    p, rng = PARAMS._replace(earth_north=0.0, earth_down=0.0), np.random.default_rng(4)
    s, sums = state_of(), sums_of(time=0.2)
    slow, white = math.radians(0.4), math.radians(0.2)
    for _ in range(3000):
        noise = rng.standard_normal()
        taken = measured(slow=slow * (1.0 + 0.01 * noise), noise=white)
        gyro_azimuth_filter.magnetic(p, s, taken, 1.0 + white * noise)
        gyro_azimuth_filter.propagate(p, s, sums, 0)
    assert s.P[Error.SLOW_ERROR, Error.SLOW_ERROR] > 0.9
    assert math.sqrt(s.P[Error.AZIMUTH, Error.AZIMUTH]) > 0.9 * slow
    assert abs(s.x[Error.AZIMUTH] - 1.0) < 0.1 * slow


def test_a_magnetic_azimuth_leaves_the_station_alone_and_its_covariance_is_joseph_s() -> None:
    root = 0.01 * np.random.default_rng(3).standard_normal((STATES, STATES))
    before, slow, constant, r2 = root @ root.T, 0.02, 0.01, 1e-4
    s = state_of(P=before)
    H = np.zeros(STATES)
    H[Error.AZIMUTH], H[Error.SLOW_ERROR], H[Error.CONSTANT_ERROR] = 1.0, slow, constant
    gain = before @ H / (H @ before @ H + r2)
    gain[Error.STATION] = 0.0
    kept = np.eye(STATES) - np.outer(gain, H)
    assert gyro_azimuth_filter.correct(s, 0.005, slow, constant, r2, 0.0)
    assert s.x[Error.STATION] == 0.0
    assert s.x[Error.AZIMUTH] == pytest.approx(gain[Error.AZIMUTH] * 0.005)
    assert_allclose(s.P, kept @ before @ kept.T + r2 * np.outer(gain, gain), atol=1e-15)


@pytest.mark.fault_case(8)
def test_beyond_the_gate_nothing_changes() -> None:
    s = state_of(P=np.eye(STATES) * 1e-6)
    assert not gyro_azimuth_filter.correct(s, 1.0, 0.0, 0.0, 1e-6, 0.0)
    assert_allclose(s.x, 0.0)
    assert_allclose(s.P, np.eye(STATES) * 1e-6)
    assert abs(s.innovation_ratio) > 4.0


def test_a_share_of_the_slow_error_fades_to_its_own_spread() -> None:
    s = state_of()
    s.x[Error.SLOW_ERROR], s.P[Error.SLOW_ERROR, Error.SLOW_ERROR] = 2.0, 0.04
    s.P[Error.SLOW_ERROR, Error.BIAS] = s.P[Error.BIAS, Error.SLOW_ERROR] = 0.1
    gyro_azimuth_filter.fade_slow_error(s, 0.5)
    found = s.x[Error.SLOW_ERROR], s.P[Error.SLOW_ERROR, Error.SLOW_ERROR], s.P[Error.BIAS, Error.SLOW_ERROR]
    assert found == (1.0, 1.0 + 0.25 * (0.04 - 1.0), 0.05)


def test_a_station_is_propagated_only_where_there_is_an_azimuth() -> None:
    s = state_of(P=np.ones((STATES, STATES)))
    gyro_azimuth_filter.station(s, StationAzimuth(1.0, 0.1, 0.05, False))
    assert not s.have_station
    s.have_azimuth = True
    gyro_azimuth_filter.station(s, StationAzimuth(1.0 + 2.0 * math.pi, 0.1, 0.05, False))
    assert s.x[Error.STATION] == pytest.approx(1.0)
    assert_allclose(s.P[Error.STATION], 0.01 * np.eye(STATES)[Error.STATION])
    assert s.station_constant_sigma == 0.05


@pytest.mark.parametrize("unit", [0, 1])
def test_the_leakage_is_found_while_the_tool_turns_and_nothing_where_it_does_not(unit: int) -> None:
    s, at = state_of(), Error.LEAKAGE + 2 * unit
    gyro_azimuth_filter.begin(PARAMS, s)
    bias, leakage = np.array([1e-5, -2e-5]), np.array([2e-4, -3e-4])
    rng = np.random.default_rng(4)
    before = s.P[at, at]
    for rate in (0.1, 12.0):
        for _ in range(100):
            across = math.radians(0.05) * 0.5 / (0.5 * rate / (2.0 * math.pi)) * rng.standard_normal(2)
            sums = sums_of(time=0.5, spin=0.5 * rate, rate=0.5 * bias + 0.5 * rate * leakage + across)
            gyro_azimuth_filter.estimate_leakage(PARAMS, s, sums, unit)
        if rate < 1.0:
            assert s.P[at, at] == before
    sigma = np.sqrt(np.diagonal(s.P)[at : at + 2])
    assert (sigma < 1.5e-5).all()
    assert (np.abs(s.x[at : at + 2] - leakage) < 3.0 * sigma).all()
    # And it outlasts an azimuth that begins anew.
    found = s.x[at : at + 2].copy()
    gyro_azimuth_filter.begin(PARAMS, s)
    assert_allclose(s.x[at : at + 2], found)
    assert_allclose(np.sqrt(np.diagonal(s.P)[at : at + 2]), sigma)


def test_an_error_that_stays_for_a_while_is_counted_once_in_that_time() -> None:
    s = state_of()
    gyro_azimuth_filter.magnetic(PARAMS, s, measured(held=0.02), 1.0)
    assert s.P[Error.AZIMUTH, Error.AZIMUTH] == pytest.approx(0.02**2)
    for _ in range(50):
        gyro_azimuth_filter.magnetic(PARAMS, s, measured(held=0.02), 1.0)
    # Fifty in ten seconds, with an error that stays for ten: half as much again as one of its own.
    assert s.P[Error.AZIMUTH, Error.AZIMUTH] == pytest.approx(0.02**2 / 1.5, rel=1e-6)


def test_a_station_that_disagrees_is_propagated_only_if_a_gyro_or_the_next_one_confirms_it() -> None:
    def propagated(*by_gyro: bool) -> float:
        s = state_of()
        s.have_azimuth = True
        gyro_azimuth_filter.station(s, StationAzimuth(1.0, 0.01, 0.005, False))
        for one in by_gyro:
            gyro_azimuth_filter.station(s, StationAzimuth(1.2, 0.01, 0.005, one))
        return float(s.x[Error.STATION])

    assert (propagated(False), propagated(True), propagated(False, False)) == (1.0, 1.2, 1.2)


@pytest.mark.parametrize(("grade", "follows"), [(400.0, True), (1.0, False)])
def test_a_biased_mean_innovation_opens_the_biases_as_far_as_the_gyro_s_grade_allows(grade, follows) -> None:
    bias = grade * math.radians(1.0) / 3600.0
    unit = PARAMS.units[0]._replace(noise=1e-5, bias=bias, walk=0.0, leakage=0.0, drift=0.0, lag=0.0)
    still = {"earth_north": 0.0, "earth_down": 0.0, "gap_rate": 0.0, "tilt_memory_s": 0.0}
    p = PARAMS._replace(**still, held_repeats=1.0, slow_error_time_s=1e9, reset_time_s=1e9, units=(unit, unit))
    s, dt, drift, sigma, rng = state_of(), 0.2, math.radians(0.003), math.radians(0.5), np.random.default_rng(3)
    for step in range(600):
        # A minute of a bias that stands still, another of one that runs away; the tool does not turn.
        running = drift * max(step * dt - 60.0, 0.0)
        sums = sums_of(time=dt, across=(dt, 0.0), noise=dt, turn=running * dt)
        gyro_azimuth_filter.propagate(p, s, sums, 0)
        s.since_seen_s = s.since_used_s = dt
        gyro_azimuth_filter.magnetic(p, s, measured(noise=sigma), rng.normal(scale=sigma))
        if step == 299:
            assert abs(s.innovation_mean) < 1.5
    assert (abs(wrap_pi(s.x[Error.AZIMUTH])) < math.radians(3.0)) == follows


def test_a_step_that_gravity_shows_opens_biases_and_azimuth_together():
    s = state_of()
    gyro_azimuth_filter.begin(PARAMS, s)
    before, sums = s.P.copy(), sums_of(time=0.5, across=(0.4, -0.3), gyro_step=1.5)
    gyro_azimuth_filter.open_bias(s, sums)
    # For 1.5 s each bias has turned the azimuth at a rate of -0.8 and 0.6 times the bias.
    moved = np.zeros((2, len(s.x)))
    for i, slope in enumerate((-1.2, 0.9)):
        moved[i, Error.BIAS + i], moved[i, :2] = 1.0, slope
    opened = s.P.copy()
    assert opened - before == pytest.approx(BIAS_STEP**2 * moved.T @ moved, abs=1e-15)
    sums.gyro_step = 0.0
    gyro_azimuth_filter.open_bias(s, sums)
    assert np.array_equal(s.P, opened)
