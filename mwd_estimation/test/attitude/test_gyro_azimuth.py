# SPDX-License-Identifier: Apache-2.0
"""Continuous azimuth: truthful through drop-outs, spikes and interference, gyro-carried, never a default."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math

import numpy as np
import pytest
from north_signals import Motion, measured, motion, steady
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from consistency import assert_consistent
from mwd_estimation.attitude import gyro_azimuth
from mwd_estimation.attitude.block import NO_STATION, StationAzimuth
from mwd_estimation.attitude.gyro_azimuth_filter import (
    BIN_EVENT,
    MAGNETIC_AZIMUTH,
    Error,
    GyroAzimuthParams,
    PrecisionRates,
    at_latitude,
    gyro_unit,
    initial,
)
from mwd_estimation.attitude.sample import SAMPLE
from mwd_estimation.core.status import Status
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import DEG_PER_HOUR
from mwd_sensors.core.frames import mat_nt, wrap_pi

DEG = math.radians(1.0)
LATITUDE = 60.0 * DEG
RATE = 20.0
BIN_NS = 500_000_000
GAP_NS = 500_000_000
MAG_SIGMA = 1.0 * DEG
# Of the magnetic sigma, what stays from sample to sample.
SHARE = 0.9
# A tactical unit; the bias is known to 2 deg/h.
UNIT = gyro_unit(0.05, 2.0, 0.0, 1000.0, 3.6, 0.5)
TACTICAL = GyroAzimuthParams(units=(UNIT, gyro_unit(0.05, 5.0, 0.3)), slow_error_time_s=1800.0)
POOR = TACTICAL._replace(units=(gyro_unit(0.42, 36.0, 0.0, 1000.0, 3.6, 0.5), TACTICAL.units[1]))


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


def magnetic(well: Drilling, rng: np.random.Generator, memory: float = 1800.0) -> Array:
    """Magnetic azimuth at 2 Hz, NaN between, with a slow Gauss-Markov error and a fast one."""
    n, fade = len(well.stamps), math.exp(-1.0 / RATE / memory)
    slow = np.empty(n)
    slow[0] = rng.standard_normal()
    kick = rng.standard_normal(n) * math.sqrt(1.0 - fade * fade)
    for i in range(1, n):
        slow[i] = fade * slow[i - 1] + kick[i]
    fast = rng.standard_normal(n) * math.sqrt(1.0 - SHARE**2)
    mag = well.azimuth + MAG_SIGMA * (SHARE * slow + fast)
    mag[np.arange(n) % 10 != 0] = np.nan
    return mag


def steps_of(stamps, start, stop, seek=(), station=()):
    """The bins that the samples from start to stop close, one bin late, with the seeks and stations of their time."""
    index = stamps // BIN_NS
    opens = np.flatnonzero(np.diff(index, prepend=index[0]) > 0)
    pairs = [(place - start, index[k - 1]) for k, place in itertools.pairwise(opens) if start <= place < stop]
    steps = np.zeros(len(pairs), dtype=BIN_EVENT)
    steps["place"], steps["bin"] = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    steps["seek_azimuth"] = steps["seek_sigma"] = np.nan
    steps["station"] = NO_STATION
    for at, *values in seek:
        steps["seek_azimuth"][steps["bin"] == index[at]], steps["seek_sigma"][steps["bin"] == index[at]] = values
    for at, *values in station:
        steps["station"][steps["bin"] == index[at]] = StationAzimuth(*values)
    return steps


def azimuths_of(stamps, mag, good, seen, constant, anew, new_start=()):
    """The magnetic azimuths of these samples."""
    rows = np.zeros(len(seen), dtype=MAGNETIC_AZIMUTH)
    rows["stamp_ns"], rows["azimuth"], rows["usable"] = stamps[seen], mag[seen], good[seen]
    rows["sigma_slow"], rows["sigma_noise"] = SHARE * MAG_SIGMA, math.sqrt(1.0 - SHARE**2) * MAG_SIGMA
    rows["sigma_constant"], rows["restart"] = constant, np.isin(seen, anew)
    rows["new_start"] = np.isin(seen, new_start)
    return rows


def go(
    well: Drilling,
    mag: Array,
    gyro: Array,
    params: GyroAzimuthParams = TACTICAL,
    good: Array | None = None,
    cuts=(),
    seek=(),
    fine=None,
    stamps=None,
    constant=0.0,
    anew=(),
    station=(),
    new_start=(),
):
    """Rows, propagated azimuths of the bins, and the state at the end."""
    n = len(mag)
    stamps = well.stamps[:n] if stamps is None else stamps
    ok = np.ones(n, dtype=bool) if good is None else good
    state = initial()
    p = at_latitude(params, 60.0)
    parts, bins, mag_from = [], [], 0
    for start, stop in zip((0, *cuts), (*cuts, n), strict=True):
        state = state.copy()
        seen = np.flatnonzero(np.isfinite(mag[mag_from:stop])) + mag_from
        rates = np.zeros((0, 3)) if fine is None else fine[:stop]
        part = slice(start, stop)
        samples = np.zeros(stop - start, dtype=SAMPLE)
        samples["stamp_ns"], samples["gyro"], samples["down"] = stamps[part], gyro[part], well.down[part]
        rows, propagated, used = gyro_azimuth.run(
            p,
            state,
            samples,
            steps_of(stamps, start, stop, seek, station),
            azimuths_of(stamps, mag, ok, seen, constant, anew, new_start),
            PrecisionRates(stamps[: len(rates)], rates),
        )
        mag_from = seen[used] if used < len(seen) else stop
        parts.append(rows)
        bins.append(propagated)
    return np.concatenate(parts), np.concatenate(bins), state[0]


def noisy(well: Drilling, rng: np.random.Generator) -> Array:
    return measured(motion_like(well), rng, 0.05, 0.42, bias=rng.standard_normal(3) * 2.0 * DEG_PER_HOUR)[0]


def motion_like(well: Drilling) -> Motion:
    return Motion(well.stamps, well.gyro, np.zeros_like(well.gyro), well.azimuth, well.azimuth)


@pytest.mark.slow
@pytest.mark.parametrize("rpm", [0.0, 60.0])
def test_sigma_is_truthful_with_mag_without_it_and_after_it_comes_back(rpm: float) -> None:
    well = drilling(400.0, rpm)
    rng = np.random.default_rng(2)
    at = np.array([200, 2000, 3900, 5500, 7900])
    found = []
    for _ in range(60):
        mag = magnetic(well, rng)
        mag[4000:5600] = np.nan
        rows, _, _ = go(well, mag, noisy(well, rng))
        found.append((wrap_pi(rows["azimuth"][at] - well.azimuth[at]), rows["sigma"][at]))
    for error, sigma in np.transpose(found, (2, 1, 0)):
        assert_consistent(error, sigma)


def test_a_precision_unit_carries_better_and_its_sigma_is_truthful_too() -> None:
    well = drilling(400.0, 60.0)
    rng = np.random.default_rng(12)
    aided = POOR._replace(units=(POOR.units[0], gyro_unit(0.05, 2.0, 0.0)))
    ratios, wide = [], []
    for _ in range(30):
        mag = magnetic(well, rng)
        mag[2000:] = np.nan
        poor = measured(motion_like(well), rng, 0.42, bias=rng.standard_normal(3) * 36.0 * DEG_PER_HOUR)[0]
        fine = noisy(well, rng)
        rows, _, _ = go(well, mag, poor, aided, fine=fine)
        alone, _, _ = go(well, mag, poor, POOR)
        ratios.append(wrap_pi(rows["azimuth"][-1] - well.azimuth[-1]) / rows["sigma"][-1])
        wide.append(alone["sigma"][-1] - rows["sigma"][-1])
    assert 0.45 < np.mean(np.square(ratios)) < 1.79
    assert min(wide) > 0.0


def test_the_magnetic_error_does_not_average_out() -> None:
    well = drilling(400.0, 60.0)
    rows, _, _ = go(well, magnetic(well, np.random.default_rng(0)), well.gyro)
    assert rows["sigma"][-1] > 0.75 * MAG_SIGMA
    assert rows["sigma"][-1] < MAG_SIGMA


def test_the_declination_s_error_never_averages_out() -> None:
    well = drilling(400.0, 60.0)
    quick = TACTICAL._replace(slow_error_time_s=1.0)
    mag = magnetic(well, np.random.default_rng(0), memory=1.0)
    rows, _, _ = go(well, mag + 0.5 * DEG, well.gyro, quick, constant=0.5 * DEG)
    assert 0.5 * DEG < rows["sigma"][-1] < 0.55 * DEG
    assert abs(wrap_pi(rows["azimuth"][-1] - well.azimuth[-1])) < 2.0 * rows["sigma"][-1]


def test_a_magnetic_azimuth_that_is_withdrawn_lets_the_azimuth_begin_anew() -> None:
    well = drilling(400.0, 60.0)
    mag = magnetic(well, np.random.default_rng(6))
    mag[:1000] += 30.0 * DEG
    rows, _, state = go(well, mag, well.gyro, anew=(1000,))
    assert np.abs(wrap_pi(rows["azimuth"][1030:] - well.azimuth[1030:])).max() < 4.0 * MAG_SIGMA
    assert state.resets == 0


@pytest.mark.parametrize("off_deg", [0.5, 2.0, 4.0, 10.0, 30.0])
@pytest.mark.parametrize("carried_is_wrong", [False, True])
def test_a_new_magnetic_start_and_the_carried_azimuth_are_two_hypotheses(
    off_deg: float, carried_is_wrong: bool
) -> None:
    """Sigma must cover both azimuths until the magnetic azimuth has lasted, because either may be right."""
    well = drilling(400.0, 60.0)
    mag = magnetic(well, np.random.default_rng(6))
    mag[slice(1000) if carried_is_wrong else slice(1000, None)] += off_deg * DEG
    rows, _, _ = go(well, mag, noisy(well, np.random.default_rng(7)), new_start=(1000,))
    contested = slice(1030, 1000 + round(55 * RATE))
    error = np.abs(wrap_pi(rows["azimuth"][contested] - well.azimuth[contested]))
    assert (error < 3.0 * rows["sigma"][contested]).all()
    if off_deg < 1.0:
        # The two azimuths agree, so sigma stays that of the carried azimuth.
        assert rows["sigma"][1100] < 1.1 * MAG_SIGMA


def test_without_mag_from_the_start_there_is_no_azimuth_until_the_gyro_gives_one() -> None:
    well = drilling(400.0, 60.0)
    none = np.full(2000, np.nan)
    rows, _, _ = go(well, none, well.gyro)
    assert np.isnan(rows["azimuth"]).all()
    assert (rows["sigma"] == math.inf).all()
    # A north seek in the bin of sample 500, reported one bin later.
    rows, _, _ = go(well, none, well.gyro, seek=[(500, float(well.azimuth[509]), 0.5 * DEG)])
    began = int(np.flatnonzero(np.isfinite(rows["azimuth"]))[0])
    assert 510 < began <= 530
    assert rows["status"][-1] == int(Status.GYRO_AIDED)
    assert np.abs(wrap_pi(rows["azimuth"] - well.azimuth[:2000])[began:]).max() < 0.1 * DEG
    assert 0.49 * DEG < rows["sigma"][-1] < 0.51 * DEG


@pytest.mark.fault_case(19)
@pytest.mark.parametrize("seconds", [5, 60])
def test_unplugged_mag_lets_sigma_grow_and_comes_back_without_a_flip(seconds: int) -> None:
    well = drilling(400.0, 60.0)
    rng = np.random.default_rng(3)
    mag = magnetic(well, rng)
    out = slice(3000, 3000 + seconds * round(RATE))
    mag[out] = np.nan
    gyro = measured(motion_like(well), rng, 0.42, bias=rng.standard_normal(3) * 36.0 * DEG_PER_HOUR)[0]
    rows, _, state = go(well, mag, gyro, POOR)
    assert rows["status"][out][-1] & Status.GYRO_AIDED
    assert rows["sigma"][out][-1] > rows["sigma"][out][0]
    assert np.abs(wrap_pi(np.diff(rows["azimuth"][2900:]))).max() < 0.5 * DEG
    assert state.resets == 0
    error = np.abs(wrap_pi(rows["azimuth"] - well.azimuth))[200:]
    assert (error < 4.0 * rows["sigma"][200:]).all()


@pytest.mark.fault_case(24)
def test_a_passing_tool_joint_is_gated_out() -> None:
    well = drilling(400.0, 60.0)
    mag = magnetic(well, np.random.default_rng(4))
    mag[3000:3200] += 25.0 * DEG
    rows, _, state = go(well, mag, well.gyro)
    assert (rows["status"][3025:3200] & Status.MAG_DISTURBED).all()
    assert np.abs(wrap_pi(rows["azimuth"][3000:3200] - well.azimuth[3000:3200])).max() < 3.0 * MAG_SIGMA
    assert rows["status"][3195] & Status.GYRO_AIDED
    assert not rows["status"][3300] & Status.GYRO_AIDED
    assert state.rejected == 20


def test_a_field_that_fails_its_check_is_never_used_however_long() -> None:
    well = drilling(400.0, 60.0)
    mag = magnetic(well, np.random.default_rng(5))
    mag[3000:] += 8.0 * DEG
    good = np.ones(len(mag), dtype=bool)
    good[3000:] = False
    rows, _, state = go(well, mag, well.gyro, good=good)
    assert abs(wrap_pi(rows["azimuth"][-1] - well.azimuth[-1])) < 3.0 * MAG_SIGMA
    assert state.disturbed > 490
    assert state.resets == 0


def test_good_azimuths_that_stay_away_are_taken_up_again_after_the_patience() -> None:
    well = drilling(400.0, 60.0)
    mag = magnetic(well, np.random.default_rng(6))
    # It began next to a fish: 30 deg off, and no check reported it.
    mag[:1000] += 30.0 * DEG
    rows, _, state = go(well, mag, well.gyro)
    assert state.resets == 1
    assert np.abs(wrap_pi(rows["azimuth"][2000] - well.azimuth[2000])) > 20.0 * DEG
    assert np.abs(wrap_pi(rows["azimuth"][-1] - well.azimuth[-1])) < 3.0 * rows["sigma"][-1]


def test_a_north_seek_tells_the_magnetic_error_and_one_that_disagrees_is_begun_anew_from() -> None:
    well = drilling(400.0, 60.0)
    mag = magnetic(well, np.random.default_rng(7))[:4000]
    without, _, plain = go(well, mag, well.gyro)
    rows, _, state = go(well, mag, well.gyro, seek=[(3900, float(well.azimuth[3909]), 0.3 * DEG)])
    assert rows["sigma"][-1] < 0.45 * DEG < without["sigma"][-1]
    assert state.P[Error.SLOW_ERROR, Error.SLOW_ERROR] < 0.5 * plain.P[Error.SLOW_ERROR, Error.SLOW_ERROR]
    away = float(well.azimuth[3909]) + 20.0 * DEG
    rows, _, state = go(well, mag, well.gyro, seek=[(3900, away, 0.3 * DEG)])
    assert state.resets == 1
    assert abs(wrap_pi(rows["azimuth"][3930] - away)) < 0.2 * DEG


def test_seeks_of_one_gyro_do_not_average_but_the_better_one_stands() -> None:
    well = drilling(400.0, 60.0)
    none = np.full(4000, np.nan)
    at = {k: float(well.azimuth[k + 9]) for k in (500, 1500, 2500)}
    seeks = [
        (500, at[500] + 0.5 * DEG, 1.0 * DEG),
        (1500, at[1500] - 0.5 * DEG, 1.2 * DEG),
        (2500, at[2500], 0.5 * DEG),
    ]
    rows, _, state = go(well, none, well.gyro, seek=seeks)
    error = wrap_pi(rows["azimuth"] - well.azimuth[:4000]) / DEG
    assert_allclose(error[[1400, 2400]], 0.5, atol=0.05)
    assert (rows["sigma"][[1400, 2400]] > 0.99 * DEG).all()
    assert_allclose(error[3400], 0.0, atol=0.05)
    assert rows["sigma"][3400] == pytest.approx(0.5 * DEG, rel=0.01)
    assert state.resets == 0


def test_a_station_is_carried_on_by_the_gyros_alone_and_its_sigma_is_truthful() -> None:
    """Interference that turns later magnetic azimuths by up to 6 deg moves the carried azimuth, not the station's."""
    well = drilling(400.0, 60.0)
    rng = np.random.default_rng(21)
    ratios = []
    for _ in range(40):
        mag = magnetic(well, rng)
        mag += np.maximum(np.arange(len(mag)) - 2000, 0) * 1e-3 * DEG
        off = 0.5 * DEG * rng.standard_normal()
        stations = [(1000, float(well.azimuth[1009]) + off, 0.5 * DEG, 0.2 * DEG, 0.0)]
        rows, bins, _ = go(well, mag, noisy(well, rng), station=stations)
        assert np.isnan(bins["station_azimuth"][:100]).all()
        last = bins[-1]
        ratios.append(wrap_pi(last["station_azimuth"] - well.azimuth[-11]) / last["station_sigma"])
    assert (bins["station_constant_sigma"][103:] == 0.2 * DEG).all()
    assert abs(wrap_pi(rows["azimuth"][-1] - well.azimuth[-1])) > 2.0 * DEG
    assert last["station_sigma"] < 0.8 * DEG
    # Chi-square, 40 degrees of freedom: 99 % band.
    assert 0.52 < np.mean(np.square(ratios)) < 1.67


def test_a_vertical_hole_has_no_azimuth() -> None:
    n = 400
    well = drilling(400.0, 60.0)
    vertical = dataclasses.replace(well, down=np.tile([1.0, 0.01, 0.0], (n, 1)))
    rows, _, _ = go(vertical, magnetic(well, np.random.default_rng(1))[:n], np.zeros((n, 3)))
    assert np.isnan(rows["azimuth"]).all()


def test_the_axis_is_carried_as_it_turns() -> None:
    """Noise-free gyros and one good azimuth at the start: 20 deg of turn later it still holds."""
    well = drilling(400.0, 60.0)
    mag = np.full(len(well.stamps), np.nan)
    mag[10] = well.azimuth[10]
    rows, _, _ = go(well, mag, well.gyro)
    assert_allclose(wrap_pi(rows["azimuth"][30:] - well.azimuth[30:]), 0.0, atol=0.1 * DEG)


def test_an_unknown_latitude_counts_as_drift_which_turns_with_nothing() -> None:
    known, unknown = (at_latitude(TACTICAL, latitude) for latitude in (60.0, None))
    assert unknown.earth_north == 0.0
    for one, other in zip(unknown.units, known.units, strict=True):
        assert one.bias == other.bias
        assert one.drift == pytest.approx(np.hypot(other.drift, 7.292e-5), rel=1e-3)


def test_blocks_of_any_length_bad_samples_and_gaps_give_the_same_bits() -> None:
    well = drilling(400.0, 60.0)
    rng = np.random.default_rng(9)
    n = 1500
    mag, gyro, stamps = magnetic(well, rng)[:n], noisy(well, rng)[:n], well.stamps[:n].copy()
    gyro[500] = np.nan
    stamps[1000:] += 3 * 10**9
    fine = noisy(well, rng)[:n]
    fine[300:320, 1] = 9.0
    stations = [(200, 0.1, 0.01, 0.005, 0.0)]
    whole, bins, _ = go(well, mag, gyro, stamps=stamps, fine=fine, station=stations)
    pieces, piece_bins, _ = go(
        well, mag, gyro, stamps=stamps, fine=fine, cuts=(1, 499, 501, 1000, 1001, 1003), station=stations
    )
    for found, expected in ((pieces, whole), (piece_bins, bins)):
        for name in expected.dtype.names:
            assert_array_equal(found[name], expected[name])
    assert whole["sigma"][995] < whole["sigma"][1025]
