"""Continuous azimuth: truthful through drop-outs, spikes and interference, gyro-carried, never a default."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest
from north_signals import DEG_H, Motion, felt, motion, steady
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from mwd_estimation import continuous_azimuth as continuous
from mwd_estimation.continuous_azimuth import AZIMUTH, ERROR, STATES, Params
from mwd_estimation.status import Status
from mwd_sensors.frames import mat_nt, wrap_pi

DEG = math.radians(1.0)
Array = NDArray[np.float64]
LATITUDE = 60.0 * DEG
RATE = 20.0
MAG_SIGMA = 1.0 * DEG
# A tactical precision unit; the bias is known to 2 deg/h.
TACTICAL = Params(latitude_deg=60.0, gyro_noise_deg_rth=0.05, gyro_bias_deg_h=2.0, gyro_walk_deg_h_rth=0.0)


@dataclasses.dataclass
class Drilling:
    stamps: NDArray[np.int64]
    gyro: Array
    down: Array
    azimuth: Array


@functools.cache
def drilling(seconds: float, rpm: float) -> Drilling:
    """Build and turn through north by 3 deg a minute while the string turns."""

    def azimuth(t: Array) -> Array:
        return np.asarray((358.0 + 0.05 * np.asarray(t)) * DEG)

    def inclination(t: Array) -> Array:
        return np.asarray((40.0 + 0.02 * np.asarray(t)) * DEG)

    clean = motion(seconds, LATITUDE, inclination, azimuth, steady(rpm), RATE)
    t = (clean.stamp_ns - 10**9) * 1e-9 - 0.5 / RATE
    down = mat_nt(inclination(t), azimuth(t), steady(rpm)(t))[:, 2, :]
    return Drilling(clean.stamp_ns, clean.gyro_t, down, clean.azimuth)


def magnetic(well: Drilling, rng: np.random.Generator, share: float = 0.9, memory: float = 1800.0) -> Array:
    """Magnetic azimuth at 2 Hz, NaN between, with a slow Gauss-Markov error and a fast one."""
    n, fade = len(well.stamps), math.exp(-1.0 / RATE / memory)
    slow = np.empty(n)
    slow[0] = rng.standard_normal()
    kick = rng.standard_normal(n) * math.sqrt(1.0 - fade * fade)
    for i in range(1, n):
        slow[i] = fade * slow[i - 1] + kick[i]
    fast = rng.standard_normal(n) * math.sqrt(1.0 - share**2)
    mag = well.azimuth + MAG_SIGMA * (share * slow + fast)
    mag[np.arange(n) % 10 != 0] = np.nan
    return mag


def go(well: Drilling, mag: Array, gyro: Array, params: Params = TACTICAL, good: Array | None = None):
    n = len(well.stamps)
    state = continuous.initial()
    ok = np.ones(n, dtype=bool) if good is None else good
    return continuous.run(params, state, well.stamps, gyro, well.down, mag, np.full(n, MAG_SIGMA), ok), state


def noisy(well: Drilling, rng: np.random.Generator) -> Array:
    return felt(motion_like(well), rng, 0.05, 0.42, bias=rng.standard_normal(3) * 2.0 * DEG_H)[0]


def motion_like(well: Drilling) -> Motion:
    return Motion(well.stamps, well.gyro, np.zeros_like(well.gyro), well.azimuth, well.azimuth)


@pytest.mark.parametrize("rpm", [0.0, 60.0])
def test_sigma_is_truthful_with_mag_without_it_and_after_it_comes_back(rpm: float) -> None:
    well = drilling(400.0, rpm)
    rng = np.random.default_rng(2)
    at = np.array([200, 2000, 3900, 5500, 7900])
    ratios = []
    for _ in range(60):
        mag = magnetic(well, rng)
        mag[4000:5600] = np.nan
        rows, _ = go(well, mag, noisy(well, rng))
        ratios.append(wrap_pi(rows.azimuth[at] - well.azimuth[at]) / rows.sigma[at])
    nees = np.mean(np.square(ratios), axis=0)
    # Chi-square, 60 degrees of freedom: 99 % band.
    assert ((nees > 0.59) & (nees < 1.53)).all(), nees


def test_the_magnetic_error_does_not_average_out() -> None:
    well = drilling(400.0, 60.0)
    rows, _ = go(well, magnetic(well, np.random.default_rng(0)), well.gyro)
    assert rows.sigma[-1] > 0.75 * MAG_SIGMA
    assert rows.sigma[-1] < MAG_SIGMA


def test_without_mag_from_the_start_there_is_no_azimuth_until_the_gyro_gives_one() -> None:
    well = drilling(400.0, 60.0)
    n = len(well.stamps)
    none = np.full(n, np.nan)
    rows, state = go(well, none, well.gyro)
    assert np.isnan(rows.azimuth).all()
    assert (rows.sigma == math.pi).all()
    assert (rows.status == int(Status.INITIALISING | Status.NO_MAG)).all()
    state = continuous.initial()
    assert continuous.update(TACTICAL, state, float(well.azimuth[0]), 0.5 * DEG)
    rows = continuous.run(TACTICAL, state, well.stamps, well.gyro, well.down, none, none, np.ones(n, dtype=bool))
    assert rows.status[-1] == int(Status.NO_MAG | Status.GYRO_AIDED)
    assert np.abs(wrap_pi(rows.azimuth - well.azimuth)).max() < 0.1 * DEG
    assert 0.49 * DEG < rows.sigma[-1] < 0.51 * DEG


@pytest.mark.parametrize("seconds", [5, 60])
def test_unplugged_mag_lets_sigma_grow_and_comes_back_without_a_flip(seconds: int) -> None:
    well = drilling(400.0, 60.0)
    rng = np.random.default_rng(3)
    mag = magnetic(well, rng)
    out = slice(3000, 3000 + seconds * round(RATE))
    mag[out] = np.nan
    poor = dataclasses.replace(TACTICAL, gyro_noise_deg_rth=0.42, gyro_bias_deg_h=36.0)
    gyro = felt(motion_like(well), rng, 0.42, bias=rng.standard_normal(3) * 36.0 * DEG_H)[0]
    rows, state = go(well, mag, gyro, poor)
    assert rows.status[out][-1] & Status.NO_MAG
    assert rows.status[out][-1] & Status.GYRO_AIDED
    assert rows.sigma[out][-1] > rows.sigma[out][0]
    assert np.abs(wrap_pi(np.diff(rows.azimuth[2900:]))).max() < 0.5 * DEG
    assert state.memory[continuous.TAKEN_UP] == 0.0
    error = np.abs(wrap_pi(rows.azimuth - well.azimuth))[200:]
    assert (error < 4.0 * rows.sigma[200:]).all()


def test_a_passing_tool_joint_is_gated_out() -> None:
    well = drilling(400.0, 60.0)
    mag = magnetic(well, np.random.default_rng(4))
    mag[3000:3200] += 25.0 * DEG
    rows, state = go(well, mag, well.gyro)
    seen = np.arange(3000, 3200, 10)
    assert (rows.status[seen] & Status.MAG_DISTURBED).all()
    assert np.abs(wrap_pi(rows.azimuth[3000:3200] - well.azimuth[3000:3200])).max() < 3.0 * MAG_SIGMA
    assert rows.status[3195] & Status.GYRO_AIDED
    assert not rows.status[3300] & Status.GYRO_AIDED
    assert state.memory[continuous.GATED] == 20.0


def test_a_field_that_fails_its_check_is_never_used_however_long() -> None:
    well = drilling(400.0, 60.0)
    mag = magnetic(well, np.random.default_rng(5))
    mag[3000:] += 8.0 * DEG
    good = np.ones(len(mag), dtype=bool)
    good[3000:] = False
    rows, state = go(well, mag, well.gyro, good=good)
    assert abs(wrap_pi(rows.azimuth[-1] - well.azimuth[-1])) < 3.0 * MAG_SIGMA
    assert state.memory[continuous.FAILED] == 500.0
    assert state.memory[continuous.TAKEN_UP] == 0.0


def test_good_azimuths_that_stay_away_are_taken_up_again_after_the_patience() -> None:
    well = drilling(400.0, 60.0)
    true = magnetic(well, np.random.default_rng(6))
    mag = true.copy()
    # It began next to a fish: 30 deg off, and nothing said so.
    mag[:1000] += 30.0 * DEG
    rows, state = go(well, mag, well.gyro)
    assert state.memory[continuous.TAKEN_UP] == 1.0
    assert np.abs(wrap_pi(rows.azimuth[2000] - well.azimuth[2000])) > 20.0 * DEG
    assert np.abs(wrap_pi(rows.azimuth[-1] - well.azimuth[-1])) < 3.0 * rows.sigma[-1]


def test_a_north_seek_beyond_the_gate_is_left_to_the_caller() -> None:
    well = drilling(400.0, 60.0)
    _, state = go(well, magnetic(well, np.random.default_rng(7)), well.gyro)
    before = state.copy()
    assert not continuous.update(TACTICAL, state, float(well.azimuth[-1]) + 20.0 * DEG, 0.3 * DEG)
    assert_array_equal(state.P, before.P)
    assert continuous.update(TACTICAL, state, float(well.azimuth[-1]), 0.3 * DEG)
    assert state.P[0, 0] < (0.31 * DEG) ** 2
    # The station also tells the magnetic error.
    assert state.P[ERROR, ERROR] < 0.5 * before.P[ERROR, ERROR]
    continuous.restart(TACTICAL, state, 1.0, 0.2 * DEG)
    assert state.x[AZIMUTH] == 1.0
    with pytest.raises(ValueError, match="positive sigma"):
        continuous.update(TACTICAL, state, 1.0, 0.0)


def test_a_vertical_hole_has_no_azimuth() -> None:
    n = 100
    down = np.tile([1.0, 0.01, 0.0], (n, 1))
    stamps = np.arange(1, n + 1) * 10**7
    mag = np.full(n, 1.0)
    rows = continuous.run(
        TACTICAL, continuous.initial(), stamps, np.zeros((n, 3)), down, mag, 0.01 * mag, np.ones(n, dtype=bool)
    )
    assert np.isnan(rows.azimuth).all()
    assert (rows.status & int(Status.NEAR_VERTICAL)).all()


def test_the_azimuth_rate_is_that_of_the_axis() -> None:
    well = drilling(400.0, 60.0)
    k = continuous.kernel_settings(TACTICAL)
    rates = []
    for w, d, azimuth in zip(well.gyro[:200], well.down[:200], well.azimuth[:200], strict=True):
        x = np.array([azimuth, 0.0, 0.0, 0.0])
        rates.append(continuous.azimuth_rate(k, x, w[1], w[2], *d))
    assert_allclose(np.mean(rates), 0.05 * DEG, rtol=0.01)


def test_propagation_is_the_derivative_of_itself() -> None:
    k = continuous.kernel_settings(TACTICAL)
    k[continuous.K_NORTH] *= 1e3
    k[continuous.K_NOISE] = k[continuous.K_WALK] = k[continuous.K_TILT] = 0.0
    args = (0.5, 0.01, -0.02, *(np.array([0.5, 0.6, math.sqrt(1.0 - 0.25 - 0.36)])))
    x = np.array([2.0, 1e-3, -2e-3, 0.7])
    F = np.zeros((STATES, STATES))
    for j in range(STATES):
        ends = []
        for sign in (1.0, -1.0):
            y = x + sign * 1e-6 * np.eye(STATES)[j]
            continuous._propagate(k, y, np.zeros((STATES, STATES)), *args)
            ends.append(y)
        F[:, j] = (ends[0] - ends[1]) / 2e-6
    root = np.random.default_rng(8).standard_normal((STATES, STATES))
    P = root @ root.T
    P[ERROR, ERROR] += 2.0
    expected = F @ P @ F.T
    expected[ERROR, ERROR] += 1.0 - F[ERROR, ERROR] ** 2
    continuous._propagate(k, x.copy(), P, *args)
    assert_allclose(P, expected, rtol=1e-6, atol=1e-9)


def test_blocks_of_any_length_bad_samples_and_gaps_give_the_same_bits() -> None:
    well = drilling(400.0, 60.0)
    rng = np.random.default_rng(9)
    mag, gyro, stamps = magnetic(well, rng), noisy(well, rng), well.stamps.copy()
    gyro[500] = np.nan
    stamps[1000:] += 3 * 10**9
    n = 1500
    ok, spread = np.ones(n, dtype=bool), np.full(n, MAG_SIGMA)
    whole = continuous.run(TACTICAL, continuous.initial(), stamps[:n], gyro[:n], well.down[:n], mag[:n], spread, ok)
    state, parts = continuous.initial(), []
    for a, b in [(0, 1), (1, 499), (499, 501), (501, 1000), (1000, 1500)]:
        state = state.copy()
        parts.append(
            continuous.run(TACTICAL, state, stamps[a:b], gyro[a:b], well.down[a:b], mag[a:b], spread[a:b], ok[a:b])
        )
    for name in ("azimuth", "sigma", "status"):
        assert_array_equal(np.concatenate([getattr(p, name) for p in parts]), getattr(whole, name))
    assert whole.status[500] & Status.REJECTED
    assert whole.status[1000] & Status.GAP
    assert whole.sigma[999] < whole.sigma[1001]
    with pytest.raises(ValueError, match="mag_good"):
        continuous.run(TACTICAL, state, stamps[:2], gyro[:2], well.down[:2], mag[:2], spread[:2], ok[:1])
