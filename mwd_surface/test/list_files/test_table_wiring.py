# SPDX-License-Identifier: Apache-2.0
"""Wrong hand, sign, order or unit and dead axes of a six-axis table are named; what only disturbs a field is not."""

from __future__ import annotations

import csv
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_estimation.core import magnetic_geometry
from mwd_estimation.core.reasons import ReasonCode
from mwd_estimation.core.verdicts import REJECT
from mwd_sensors.core.frames import mat_nt
from mwd_surface.list_files.six_axis_table import single_stations, table_rows
from project import REFERENCE_DATA

DEG = math.pi / 180.0
TOTAL, DIP, DECLINATION = 50e-6, 65.0 * DEG, 3.0 * DEG
FORCE = ("grav_axial_mps2", "grav_tran1_mps2", "grav_tran2_mps2")
FIELD = ("mag_axial_nT", "mag_tran1_nT", "mag_tran2_nT")
WAYS = [
    np.diag(signs)[list(order)]
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
]
CODES = {ReasonCode.WIRING, ReasonCode.TABLE_UNIT, ReasonCode.DEAD_AXIS}


def run(seed, *, angles=True, outside_nt=0.0, string_nt=0.0, count=10, built_deg=75.0):
    """Columns of a run that builds from 15 deg, turning by 40 deg, with sensor errors as of a tool code."""
    rng = np.random.default_rng(seed)
    north = TOTAL * math.cos(DIP)
    b_n = np.array([north * math.cos(DECLINATION), north * math.sin(DECLINATION), TOTAL * math.sin(DIP)])
    tilt, start = np.linspace(15.0, built_deg, count) * DEG, rng.uniform(0.0, math.tau)
    azimuth = start + np.linspace(0.0, 40.0, count) * DEG
    bias = rng.normal([string_nt, 0.0, 0.0], 70.0)
    g, b = np.empty((count, 3)), np.empty((count, 3))
    for k in range(count):
        mat_tn = mat_nt(tilt[k], azimuth[k], rng.uniform(0.0, math.tau)).T
        outside = outside_nt * 1e-9 * rng.normal(size=3)
        g[k] = mat_tn @ [0.0, 0.0, 9.81] + rng.normal(0.0, 0.003, 3)
        b[k] = 1e9 * mat_tn @ (b_n + outside) + bias + rng.normal(0.0, 20.0, 3)
    printed = {"incl_deg": tilt / DEG, "azi_true_deg": azimuth / DEG % 360.0} if angles else {}
    return g, b, printed


def columns(g, b, printed):
    table = {name: g[:, k] for k, name in enumerate(FORCE)} | {name: b[:, k] for k, name in enumerate(FIELD)}
    count = len(g)
    table |= {"b_ref_nT": [TOTAL * 1e9] * count, "dip_ref_deg": [DIP / DEG] * count}
    return table | {"decl_deg": [DECLINATION / DEG] * count} | printed


def faults(g, b, printed):
    rows = table_rows(columns(g, b, printed))
    found = {tuple(reason.code for reason in row.faults) for row in rows}
    (codes,) = found
    return set(codes)


@settings(max_examples=settings().max_examples // 2, deadline=None)
@given(seed=st.integers(0, 1000), p=st.integers(0, 47), q=st.integers(0, 47))
def test_with_angles_in_the_table_every_wrong_wiring_that_moves_the_hole_is_named(seed, p, q):
    g, b, printed = run(seed)
    wired = g @ WAYS[p].T, b @ WAYS[q].T
    rows = table_rows(columns(*wired, {}))
    alone = single_stations(rows)
    there = magnetic_geometry.raw_azimuth(-wired[0], wired[1]) + DECLINATION
    tilt = np.array([row.station.inclination for row in alone])
    truth = printed["incl_deg"] * DEG, printed["azi_true_deg"] * DEG
    axes = [mat_nt(i, a, 0.0)[..., 0] for i, a in ((tilt, there), truth)]
    off = np.degrees(np.arccos(np.clip(np.sum(axes[0] * axes[1], axis=1), -1.0, 1.0)))
    found = faults(*wired, printed)
    if np.median(off) > 9.0:
        assert found == {ReasonCode.WIRING}
    elif np.median(off) < 4.0:
        assert ReasonCode.WIRING not in found


@pytest.mark.parametrize("q", [k for k, way in enumerate(WAYS) if not np.allclose(np.abs(way), np.eye(3))][::3])
def test_without_angles_a_wiring_of_one_sensor_is_named_by_the_dips(q):
    g, b, _ = run(q)
    assert faults(g, b @ WAYS[q].T, {}) == {ReasonCode.WIRING}
    assert faults(g @ WAYS[q].T, b, {}) == {ReasonCode.WIRING}


@pytest.mark.parametrize("p", range(len(WAYS)))
def test_without_angles_a_transverse_axis_in_the_place_of_the_axial_one_is_named_by_the_depths(p):
    g, b, _ = run(p, count=16)
    order = np.random.default_rng(p).permutation(len(g))
    table = columns(g @ WAYS[p].T, b @ WAYS[p].T, {"md_m": 500.0 + 28.0 * np.arange(len(g))})
    shuffled = {name: np.asarray(cells)[order] for name, cells in table.items()}
    found = {reason.code for row in table_rows(shuffled) for reason in row.faults}
    assert found == (set() if WAYS[p][0, 0] else {ReasonCode.WIRING})


@pytest.mark.parametrize("built_deg", [75.0, 92.0])
def test_without_angles_the_other_sign_of_gravity_is_named_before_a_slip_of_the_reference(built_deg):
    g, b, _ = run(11, built_deg=built_deg)
    for row in single_stations(table_rows(columns(-g, b, {}))):
        assert row.station.headline.code is ReasonCode.WIRING
    wrong_reference = columns(g, b, {}) | {"dip_ref_deg": [-DIP / DEG] * len(g)}
    assert not any(row.faults for row in table_rows(wrong_reference))


@settings(max_examples=settings().max_examples // 2, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    outside=st.sampled_from([0.0, 1000.0, 5000.0]),
    string=st.sampled_from([0.0, 1500.0, 3000.0]),
    angles=st.booleans(),
)
def test_interference_is_no_wrong_wiring(seed, outside, string, angles):
    assert not faults(*run(seed, outside_nt=outside, string_nt=string, angles=angles))


@pytest.mark.parametrize(
    ("force", "field"),
    [(1.0, 1e-3), (1.0, 1e-5), (1.0, 1e-2), (1.0 / 9.80665, 1.0), (1.0 / 0.3048, 1.0), (1e3 / 9.80665, 1e-3)],
)
def test_readings_in_another_unit_than_the_header_says_are_named(force, field):
    g, b, printed = run(3)
    assert faults(force * g, field * b, printed) == {ReasonCode.TABLE_UNIT}


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sensor", [0, 1])
@pytest.mark.parametrize("value", [0.0, 0.3])
def test_an_axis_that_does_not_follow_is_named(axis, sensor, value):
    readings = list(run(5))
    readings[sensor][:, axis] = value * [9.81, 50e3][sensor]
    assert faults(*readings) == {ReasonCode.DEAD_AXIS}


def test_a_named_fault_rejects_all_angles_of_all_rows():
    g, b, printed = run(7)
    rows = table_rows(columns(g[:, [0, 2, 1]], b[:, [0, 2, 1]], printed))
    for row in single_stations(rows):
        assert {row.station.verdicts.inclination, row.station.verdicts.azimuth} == {REJECT}
        assert row.station.headline.code is ReasonCode.WIRING


def test_volve_with_its_transverse_axes_exchanged_is_left_handed():
    with (REFERENCE_DATA / "volve" / "volve_F5_raw_sixaxis.csv").open() as file:
        rows = list(csv.DictReader(file))
    table = {name: [row[name] for row in rows] for name in rows[0]}
    assert not any(CODES & {reason.code for reason in row.faults} for row in table_rows(table))
    for stem, unit in (("grav", "mps2"), ("mag", "nT")):
        first, second = f"{stem}_tran1_{unit}", f"{stem}_tran2_{unit}"
        table[first], table[second] = table[second], table[first]
    (reason,) = {reason for row in table_rows(table) for reason in row.faults}
    assert reason.code is ReasonCode.WIRING
    assert "the axes are left-handed" in reason.names
