"""The filter of the carried azimuth: its slopes, and an anchor that no magnetic azimuth moves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mwd_estimation.attitude import azimuth_rate, gyro_azimuth_filter
from mwd_estimation.attitude.gyro_azimuth import Params, kernel_settings
from mwd_estimation.attitude.gyro_azimuth_filter import ANCHOR, AZIMUTH, BIAS, CONSTANT, ERROR, STATES


def settings() -> np.ndarray:
    return kernel_settings(Params(gyro_noise_deg_rth=0.05, gyro_bias_deg_h=2.0), 60.0)


@pytest.mark.parametrize("unit", [0, 1])
def test_propagation_is_the_derivative_of_itself(unit: int) -> None:
    k = settings()
    k[gyro_azimuth_filter.K_NORTH] *= 1e3
    for at in (gyro_azimuth_filter.K_NOISE, gyro_azimuth_filter.K_WALK):
        k[at : at + 2] = 0.0
    sums = np.zeros(azimuth_rate.SUMS)
    sums[azimuth_rate.S_TURN : azimuth_rate.S_NOISE] = 0.02, 0.3, -0.4, 0.5, 0.6
    sums[azimuth_rate.S_XY :] = 0.7, -0.2, 6.0, 0.01, 0.02, -0.3
    x = np.array([2.0, 0.7, -0.3, 1.2, 1e-3, -2e-3, 3e-3, 1e-3, 1e-4, 2e-4, -3e-4, 1e-4, 1e-5, 2e-5, 1e-3, 2e-3])
    F = np.zeros((STATES, STATES))
    for j in range(STATES):
        ends = []
        for sign in (1.0, -1.0):
            y = x + sign * 1e-6 * np.eye(STATES)[j]
            gyro_azimuth_filter.propagate(k, y, np.zeros((STATES, STATES)), sums, unit)
            ends.append(y)
        F[:, j] = (ends[0] - ends[1]) / 2e-6
    root = np.random.default_rng(8).standard_normal((STATES, STATES))
    P = root @ root.T
    P[ERROR, ERROR] += 2.0
    expected = F @ P @ F.T
    expected[ERROR, ERROR] += 1.0 - F[ERROR, ERROR] ** 2
    gyro_azimuth_filter.propagate(k, x.copy(), P, sums, unit)
    assert_allclose(P, expected, rtol=1e-6, atol=1e-9)
    assert abs(F[AZIMUTH, AZIMUTH] - 1.0) > 1e-3
    assert abs(F[ANCHOR, ANCHOR] - F[AZIMUTH, AZIMUTH]) > 1e-4


def test_noise_moves_azimuth_and_anchor_together() -> None:
    k = settings()
    sums = np.zeros(azimuth_rate.SUMS)
    sums[azimuth_rate.S_TIME], sums[azimuth_rate.S_NOISE] = 0.5, 1.0
    P = np.zeros((STATES, STATES))
    gyro_azimuth_filter.propagate(k, np.zeros(STATES), P, sums, 0)
    noise = k[gyro_azimuth_filter.K_NOISE] ** 2
    assert noise > 0.0
    assert_allclose(P[np.ix_([AZIMUTH, ANCHOR], [AZIMUTH, ANCHOR])], noise, rtol=1e-12)


def test_a_sigma_that_flickers_with_the_noise_neither_averages_its_error_down_nor_moves_the_azimuth() -> None:
    k, rng = settings(), np.random.default_rng(4)
    k[[gyro_azimuth_filter.K_NORTH, gyro_azimuth_filter.K_DOWN]] = 0.0
    x, P = np.zeros(STATES), np.zeros((STATES, STATES))
    memory = np.zeros(gyro_azimuth_filter.MEMORY)
    slow, white = math.radians(0.4), math.radians(0.2)
    sums = np.zeros(azimuth_rate.SUMS)
    sums[azimuth_rate.S_TIME] = 0.2
    for _ in range(3000):
        noise = rng.standard_normal()
        sigma = np.array([slow * (1.0 + 0.01 * noise), 0.0, white, 0.0])
        gyro_azimuth_filter.magnetic(k, x, P, memory, 1.0 + white * noise, sigma, True, False)
        gyro_azimuth_filter.propagate(k, x, P, sums, 0)
    assert P[ERROR, ERROR] > 0.9
    assert math.sqrt(P[AZIMUTH, AZIMUTH]) > 0.9 * slow
    assert abs(x[AZIMUTH] - 1.0) < 0.1 * slow


def test_a_magnetic_azimuth_leaves_the_anchor_alone_and_its_covariance_is_joseph_s() -> None:
    k = settings()
    memory = np.zeros(gyro_azimuth_filter.MEMORY)
    root = 0.01 * np.random.default_rng(3).standard_normal((STATES, STATES))
    x, P = np.zeros(STATES), root @ root.T
    before, slow, lasting, r2 = P.copy(), 0.02, 0.01, 1e-4
    H = np.zeros(STATES)
    H[AZIMUTH], H[ERROR], H[CONSTANT] = 1.0, slow, lasting
    gain = before @ H / (H @ before @ H + r2)
    gain[ANCHOR] = 0.0
    kept = np.eye(STATES) - np.outer(gain, H)
    assert gyro_azimuth_filter.correct(k, x, P, memory, slow, lasting, 0.005, r2, 0.0)
    assert x[ANCHOR] == 0.0
    assert x[AZIMUTH] == pytest.approx(gain[AZIMUTH] * 0.005)
    assert_allclose(P, kept @ before @ kept.T + r2 * np.outer(gain, gain), atol=1e-15)


def test_beyond_the_gate_nothing_changes() -> None:
    k, memory = settings(), np.zeros(gyro_azimuth_filter.MEMORY)
    x, P = np.zeros(STATES), np.eye(STATES) * 1e-6
    assert not gyro_azimuth_filter.correct(k, x, P, memory, 0.0, 0.0, 1.0, 1e-6, 0.0)
    assert_allclose(x, 0.0)
    assert_allclose(P, np.eye(STATES) * 1e-6)
    assert abs(memory[gyro_azimuth_filter.RATIO]) > 4.0


def test_a_share_of_the_slow_error_fades_to_its_own_spread() -> None:
    x, P = np.zeros(STATES), np.zeros((STATES, STATES))
    x[ERROR], P[ERROR, ERROR], P[ERROR, BIAS] = 2.0, 0.04, 0.1
    P[BIAS, ERROR] = 0.1
    gyro_azimuth_filter.fade(x, P, 0.5)
    assert (x[ERROR], P[ERROR, ERROR], P[BIAS, ERROR]) == (1.0, 1.0 + 0.25 * (0.04 - 1.0), 0.05)


def test_a_station_is_carried_on_only_where_there_is_an_azimuth() -> None:
    memory, x, P = np.zeros(gyro_azimuth_filter.MEMORY), np.zeros(STATES), np.ones((STATES, STATES))
    gyro_azimuth_filter.station(x, P, memory, 1.0, 0.1, 0.05, False)
    assert memory[gyro_azimuth_filter.ANCHORED] == 0.0
    memory[gyro_azimuth_filter.HAVE] = 1.0
    gyro_azimuth_filter.station(x, P, memory, 1.0 + 2.0 * math.pi, 0.1, 0.05, False)
    assert x[ANCHOR] == pytest.approx(1.0)
    assert_allclose(P[ANCHOR], 0.01 * np.eye(STATES)[ANCHOR])
    assert memory[gyro_azimuth_filter.ANCHOR_LASTING] == 0.05


@pytest.mark.parametrize("unit", [0, 1])
def test_what_leaks_of_the_spin_is_found_while_the_tool_turns_and_nothing_where_it_does_not(unit: int) -> None:
    k, memory = settings(), np.zeros(gyro_azimuth_filter.MEMORY)
    x, P = np.zeros(STATES), np.zeros((STATES, STATES))
    gyro_azimuth_filter.begin(k, x, P, memory)
    bias, leak = np.array([1e-5, -2e-5]), np.array([2e-4, -3e-4])
    rng = np.random.default_rng(4)
    at = gyro_azimuth_filter.LEAK + 2 * unit
    before = P[at, at]
    for rate in (0.1, 12.0):
        sums = np.zeros(azimuth_rate.SUMS)
        sums[azimuth_rate.S_TIME], sums[azimuth_rate.S_SPIN] = 0.5, 0.5 * rate
        for _ in range(100):
            across = math.radians(0.05) * 0.5 / (0.5 * rate / (2.0 * math.pi)) * rng.standard_normal(2)
            sums[azimuth_rate.S_RATE_Y : azimuth_rate.S_RATE_Z + 1] = 0.5 * bias + 0.5 * rate * leak + across
            gyro_azimuth_filter.spun(k, x, P, sums, unit)
        if rate < 1.0:
            assert P[at, at] == before
    sigma = np.sqrt(np.diagonal(P)[at : at + 2])
    assert (sigma < 1.5e-5).all()
    assert (np.abs(x[at : at + 2] - leak) < 3.0 * sigma).all()
    # And it outlasts an azimuth that begins anew.
    found = x[at : at + 2].copy()
    gyro_azimuth_filter.begin(k, x, P, memory)
    assert_allclose(x[at : at + 2], found)
    assert_allclose(np.sqrt(np.diagonal(P)[at : at + 2]), sigma)


def test_an_error_that_stays_for_a_while_is_counted_once_in_that_time() -> None:
    k, memory = settings(), np.zeros(gyro_azimuth_filter.MEMORY)
    x, P = np.zeros(STATES), np.zeros((STATES, STATES))
    sigma = np.array([0.0, 0.02, 0.0, 0.0])
    gyro_azimuth_filter.magnetic(k, x, P, memory, 1.0, sigma, True, False)
    assert P[AZIMUTH, AZIMUTH] == pytest.approx(0.02**2)
    for _ in range(50):
        gyro_azimuth_filter.magnetic(k, x, P, memory, 1.0, sigma, True, False)
    # Fifty in ten seconds, with an error that stays for ten: half as much again as one of its own.
    assert P[AZIMUTH, AZIMUTH] == pytest.approx(0.02**2 / 1.5, rel=1e-6)


def test_a_station_that_disagrees_is_carried_on_only_if_a_gyro_or_the_next_one_says_so_too() -> None:
    def carried(*sought: bool) -> float:
        memory, x, P = np.zeros(gyro_azimuth_filter.MEMORY), np.zeros(STATES), np.zeros((STATES, STATES))
        memory[gyro_azimuth_filter.HAVE] = 1.0
        gyro_azimuth_filter.station(x, P, memory, 1.0, 0.01, 0.005, False)
        for one in sought:
            gyro_azimuth_filter.station(x, P, memory, 1.2, 0.01, 0.005, one)
        return float(x[ANCHOR])

    assert (carried(False), carried(True), carried(False, False)) == (1.0, 1.2, 1.2)


@pytest.mark.parametrize(("grade", "follows"), [(400.0, True), (1.0, False)])
def test_good_azimuths_that_lean_to_one_side_open_the_biases_as_far_as_the_gyro_s_grade_allows(grade, follows) -> None:
    bias = grade * math.radians(1.0) / 3600.0
    k = np.zeros(gyro_azimuth_filter.SETTINGS)
    k[gyro_azimuth_filter.K_GATE], k[gyro_azimuth_filter.K_PATIENCE], k[gyro_azimuth_filter.K_TIMEOUT] = 4.0, 1e9, 2.0
    k[gyro_azimuth_filter.K_BIAS] = k[gyro_azimuth_filter.K_BIAS + 1] = bias
    k[gyro_azimuth_filter.K_OFTEN], k[gyro_azimuth_filter.K_TAU] = 1.0, 1e9
    k[gyro_azimuth_filter.K_NOISE] = k[gyro_azimuth_filter.K_NOISE + 1] = 1e-5
    x, P, m = np.zeros(STATES), np.zeros((STATES, STATES)), np.zeros(gyro_azimuth_filter.MEMORY)
    sums = np.zeros(azimuth_rate.SUMS)
    dt, drift, sigma = 0.2, math.radians(0.003), np.array([0.0, 0.0, math.radians(0.5), 0.0])
    sums[azimuth_rate.S_TIME], sums[azimuth_rate.S_Y], sums[azimuth_rate.S_NOISE] = dt, dt, dt
    rng, off = np.random.default_rng(3), []
    for step in range(600):
        # A minute of a bias that stands still, another of one that runs away; the tool does not turn.
        running = drift * max(step * dt - 60.0, 0.0)
        sums[azimuth_rate.S_TURN] = running * dt
        gyro_azimuth_filter.propagate(k, x, P, sums, 0)
        m[gyro_azimuth_filter.SINCE_SEEN] = m[gyro_azimuth_filter.SINCE_USED] = dt
        gyro_azimuth_filter.magnetic(k, x, P, m, rng.normal(scale=sigma[2]), sigma, True, False)
        off.append(math.degrees((x[AZIMUTH] + math.pi) % math.tau - math.pi))
        if step == 299:
            assert abs(m[gyro_azimuth_filter.LEAN]) < 1.5
    assert (abs(off[-1]) < 3.0) == follows
