# SPDX-License-Identifier: Apache-2.0
"""Stations of a table taken together: what a run shows of its string, what it revises, and what it leaves out."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.station import StationSettings
from mwd_sensors.core.frames import mat_nt, wrap_pi
from mwd_surface.list_files.six_axis_table import TableRow, single_stations, table_rows
from mwd_surface.surveys.table_run import run_stations

pytestmark = pytest.mark.slow(0.7)

REFERENCE = Reference(total=50e-6, dip=math.radians(70.0), declination=math.radians(2.0), gravity=9.81)
SETTINGS = StationSettings()


def drawn(seed, count=12, axial_nt=1200.0, steel=(), name=""):
    """Rows of a run that builds from 10 to 70 deg and turns by 20 deg, and their true azimuths."""
    rng = np.random.default_rng(seed)
    north = REFERENCE.horizontal * np.array([math.cos(REFERENCE.declination), math.sin(REFERENCE.declination), 0.0])
    b_n = north + np.array([0.0, 0.0, REFERENCE.vertical])
    bias = rng.normal(0.0, 70e-9, 3) + np.array([axial_nt * 1e-9, 0.0, 0.0])
    inclination, azimuth = np.radians(np.linspace(10.0, 70.0, count)), np.radians(np.linspace(60.0, 80.0, count))
    rows = []
    for k in range(count):
        mat_tn = mat_nt(inclination[k], azimuth[k], rng.uniform(0.0, math.tau)).T
        outside = np.array([0.0, 3e-6, 1e-6]) if k in steel else np.zeros(3)
        f_t = mat_tn @ np.array([0.0, 0.0, -9.81]) + rng.normal(0.0, 5e-4, 3)
        b_t = mat_tn @ (b_n + outside) + bias + rng.normal(0.0, 10e-9, 3)
        rows.append(TableRow(1000.0 + 30.0 * k, "", name, f_t, b_t, REFERENCE))
    return rows, azimuth


@functools.cache
def sound():
    """Rows of a sound run, their true azimuths, and the rows taken together."""
    rows, azimuth = drawn(1)
    return rows, azimuth, run_stations(rows, SETTINGS)


def off(found, azimuth, which="station"):
    return wrap_pi(np.array([getattr(row, which).azimuth for row in found]) - azimuth)


def test_a_run_knows_its_string_better_than_any_row_by_itself():
    rows, azimuth, together = sound()
    alone = single_stations(rows, SETTINGS)
    assert np.abs(off(together, azimuth)).max() < 0.3 * np.abs(off(alone, azimuth)).max()
    assert all(row.station.verdict == "accept" for row in together)
    sigma = [row.station.sigma_azimuth for row in together]
    assert sigma[0] < together[0].first.sigma_azimuth


def test_the_first_value_knows_the_rows_before_it_only_and_the_first_of_all_is_a_row_by_itself():
    rows, _, whole = sound()
    part = run_stations(rows[:5], SETTINGS)
    for long, short in zip(whole[:5], part, strict=True):
        assert long.first.azimuth == short.first.azimuth
        assert long.first.sigma_azimuth == short.first.sigma_azimuth
    assert whole[0].first.azimuth == single_stations(rows[:1], SETTINGS)[0].station.azimuth
    (only,) = run_stations(rows[:1], SETTINGS)
    assert only.station.azimuth == only.first.azimuth
    assert only.first.verdict == only.station.verdict


@pytest.mark.parametrize("share", [0.01, 0.025])
def test_magnetic_mud_is_named_and_leaves_the_stations_accepted_within_their_sigma(share):
    rows, azimuth = drawn(4, axial_nt=150.0)
    shielded = [replace(row, b_t=row.b_t * np.array([1.0, 1.0 - share, 1.0 - share])) for row in rows]
    found = run_stations(shielded, SETTINGS)
    sigma = np.array([row.station.sigma_azimuth for row in found])
    assert np.abs(off(found, azimuth) / sigma).max() < 3.0
    assert sum(row.station.verdict == "accept" for row in found) >= 11
    odds = dict(found[-1].station.hypotheses)
    assert share < 0.02 or odds["shielding"] > 0.5


def test_rows_without_times_are_taken_stand_after_stand():
    rows, _, untimed = sound()
    timed = [replace(row, time=f"2026-06-01T{k // 2:02d}:{30 * (k % 2):02d}:00") for k, row in enumerate(rows)]
    for without, given in zip(untimed, run_stations(timed, SETTINGS), strict=True):
        assert without.station.azimuth == pytest.approx(given.station.azimuth, abs=1e-9)
        assert without.station.sigma_azimuth == pytest.approx(given.station.sigma_azimuth, rel=1e-6)


@pytest.mark.parametrize("given", ["depth", "time"])
def test_the_order_of_rows_with_depths_or_times_has_no_meaning(given):
    rows, _, expected = sound()
    if given == "time":
        rows = [
            replace(row, md=math.nan, time=f"2026-06-01T{k // 2:02d}:{30 * (k % 2):02d}:00")
            for k, row in enumerate(rows)
        ]
        expected = run_stations(rows, SETTINGS)
    order = np.random.default_rng(2).permutation(len(rows))
    for place, found in zip(order, run_stations([rows[k] for k in order], SETTINGS), strict=True):
        assert found.station.azimuth == expected[place].station.azimuth
        assert found.first.sigma_azimuth == expected[place].first.sigma_azimuth


def test_a_multi_station_analysis_of_the_run_stands_beside_its_azimuths():
    errors, sigmas = [], []
    for seed in range(20, 23):
        rows, azimuth = drawn(seed)
        for row, truth in zip(run_stations(rows, SETTINGS), azimuth, strict=True):
            beside = row.station.by_method("msa")
            assert beside.refused is None
            errors.append(wrap_pi(beside.azimuth - truth))
            sigmas.append(beside.sigma)
    # Its field and reference are exact: no more than its sigma is asked.
    assert np.mean(np.square(errors)) < np.mean(np.square(sigmas))
    alone, _ = drawn(3, count=2)
    assert run_stations(alone, SETTINGS)[0].station.by_method("msa") is None


def test_a_row_played_twice_stays_doubtful_and_changes_nothing_of_the_others():
    rows, _, once = sound()
    twice = run_stations([*rows, rows[4]], SETTINGS)
    assert twice[-1].station.verdicts.azimuth == twice[-1].first.verdicts.azimuth == "doubtful"
    for one, alone in zip(twice, once, strict=False):
        assert one.station.azimuth == pytest.approx(alone.station.azimuth, abs=1e-3)
        assert one.station.verdict == alone.station.verdict == "accept"


def test_two_runs_in_one_table_are_two_runs():
    one, _ = drawn(3, count=6, axial_nt=1500.0, name="1")
    other, _ = drawn(4, count=6, axial_nt=-1500.0, name="2")
    mixed = [row for pair in zip(one, other, strict=True) for row in pair]
    found = run_stations(mixed, SETTINGS)
    for k, row in enumerate(run_stations(one, SETTINGS)):
        assert found[2 * k].station.azimuth == row.station.azimuth
        assert found[2 * k].run == "1"


def test_rows_beside_steel_are_outliers_and_do_not_move_the_others():
    _, azimuth, clean = sound()
    rows, _ = drawn(1, steel=(5, 6))
    found = run_stations(rows, SETTINGS)
    assert [k for k, row in enumerate(found) if row.outlier] == [5, 6]
    assert all(row.station.verdict != "accept" for row in found[5:7])
    rest = [k for k in range(len(rows)) if k not in (5, 6)]
    expected = off(clean, azimuth)
    np.testing.assert_allclose(off(found, azimuth)[rest], expected[rest], atol=math.radians(0.1))


def test_a_row_that_cannot_be_read_is_rejected_and_tells_nothing():
    rows, _ = drawn(6, count=6)
    table = {
        "md_m": [row.md for row in rows],
        "bha": ["4"] * len(rows),
        **{f"accel_{a}_mps2": [row.f_t[k] for row in rows] for k, a in enumerate(("axial", "tran1", "tran2"))},
        **{f"mag_{a}_nt": [row.b_t[k] * 1e9 for row in rows] for k, a in enumerate(("axial", "tran1", "tran2"))},
    }
    table["mag_axial_nt"][3] = "x"
    read = table_rows(table, REFERENCE)
    assert {row.run for row in read} == {"4"}
    found = run_stations(read, SETTINGS)
    assert found[3].station.verdict == "reject"
    without = run_stations(rows[:3] + rows[4:], SETTINGS)
    assert found[0].station.azimuth == pytest.approx(without[0].station.azimuth, abs=1e-9)
    with pytest.raises(ValueError, match="there is no column 'Run'"):
        table_rows(table, REFERENCE, run="Run")


def test_the_azimuth_beside_steel_is_limited_by_the_accepted_stations_next_to_it():
    for seed in range(2):
        rows, azimuth = drawn(seed, steel=(6, 7))
        beside, alone = (run_stations(some, SETTINGS) for some in (rows, [replace(row, md=math.nan) for row in rows]))
        for k in range(len(rows)):
            one, other = beside[k].station, alone[k].station
            assert abs(wrap_pi(one.azimuth - azimuth[k])) < 3.0 * one.sigma_azimuth
            if k in (6, 7):
                assert one.verdict == other.verdict == "doubtful"
                assert one.sigma_azimuth < 0.9 * other.sigma_azimuth
            else:
                assert (one.azimuth, one.sigma_azimuth) == (other.azimuth, other.sigma_azimuth)
