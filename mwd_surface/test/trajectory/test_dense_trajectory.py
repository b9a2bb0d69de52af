# SPDX-License-Identifier: Apache-2.0
"""The hole between stations: slides where they were made, continuous data anchored at the stations, arcs elsewhere."""

import math

import numpy as np
import pytest

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.trajectory.dense_trajectory import ARC, CONTINUOUS, SLIDES, STATION, Continuous, dense_trajectory
from mwd_surface.trajectory.slide_sheet import ROTATE, SLIDE, DrilledStretch
from mwd_surface.trajectory.well_path import path_of

STAND, SLID = 30.0, 10.0
RATE = math.radians(9.0) / 30.0  # of a slide, rad/m
AZIMUTH = math.radians(40.0)


def _inclination(md):
    """Build of 3 deg a stand, all of it in the first ten metres, as Stockhausen and Lesso's pattern."""
    stands, rest = np.divmod(np.asarray(md, dtype=float), STAND)
    return math.radians(10.0) + RATE * (stands * SLID + np.minimum(rest, SLID))


def _true_positions(md):
    fine = np.linspace(0.0, md[-1], round(md[-1] * 100) + 1)
    tangents = mc.tangent(_inclination(fine), np.full(fine.shape, AZIMUTH))
    steps = 0.5 * (tangents[1:] + tangents[:-1]) * np.diff(fine)[:, None]
    whole = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    return np.column_stack([np.interp(md, fine, whole[:, k]) for k in range(3)])


def _path(count=20):
    md = STAND * np.arange(count + 1)
    inclination, azimuth = _inclination(md), np.full(md.shape, AZIMUTH)
    positions = mc.path(md, inclination, azimuth)
    kinds = ("tie-on", *["survey"] * count)
    return path_of("main", North.TRUE, 0.0, (md, inclination, azimuth), positions, kinds, tuple(range(count + 1)))


def _sheet(count=20):
    found = []
    for k in range(count):
        found.append(DrilledStretch(SLIDE, STAND * k, STAND * k + SLID, 0, 1, toolface=0.0))
        found.append(DrilledStretch(ROTATE, STAND * k + SLID, STAND * (k + 1), 1, 2, rotary_speed=12.0))
    return found


def test_the_slide_sheet_gives_the_depth_of_the_hole_where_arcs_drift_away():
    path = _path()
    found = dense_trajectory(path, stretches=_sheet())
    true = _true_positions(path.md)
    drift = path.positions[-1, 2] - true[-1, 2]
    # Slides at the top of each stand: the hole is more inclined than the arcs, and shallower by metres.
    assert drift > 2.0
    at_stations = np.array([source == STATION for source in found.source])
    assert found.md[at_stations] == pytest.approx(path.md)
    assert found.positions[at_stations] == pytest.approx(true, abs=0.005)
    assert found.differences[-1] == pytest.approx(true[-1] - path.positions[-1], abs=0.005)
    assert set(found.source) == {STATION, SLIDES}


def test_continuous_data_give_it_too_whatever_offset_and_north_they_have():
    path, rng = _path(), np.random.default_rng(3)
    md = np.arange(0.0, 600.0, 0.2)
    inclination = _inclination(md) + math.radians(0.3) + rng.normal(0.0, math.radians(0.1), md.shape)
    azimuth = (AZIMUTH + math.radians(172.0) + rng.normal(0.0, math.radians(1.0), md.shape)) % math.tau
    found = dense_trajectory(path, Continuous(md, inclination, azimuth), _sheet())
    assert set(found.source) == {STATION, CONTINUOUS}
    at_stations = np.array([source == STATION for source in found.source])
    assert found.inclination[at_stations] == pytest.approx(path.inclination)
    assert found.azimuth[at_stations] == pytest.approx(path.azimuth)
    assert found.positions[-1, 2] == pytest.approx(_true_positions(path.md)[-1, 2], abs=0.15)


def test_gaps_in_the_data_leave_the_interval_to_the_slide_sheet_and_then_to_the_arc():
    path = _path(4)
    md = np.arange(0.0, 30.0, 0.5)
    found = dense_trajectory(path, Continuous(md, _inclination(md), np.full(md.shape, np.nan)), _sheet()[2:4])
    sources = [found.source[int(np.searchsorted(found.md, depth))] for depth in (15.5, 45.5, 75.5, 105.5)]
    assert sources == [CONTINUOUS, SLIDES, ARC, ARC]
    below = found.md > 61.0
    # An arc keeps what was gained above and adds nothing.
    assert np.ptp(found.differences[below], axis=0) == pytest.approx(np.zeros(3), abs=1e-9)


def test_continuous_data_of_another_depth_are_refused_in_words():
    path = _path(2)
    md = np.arange(0.0, 60.0, 0.5)
    found = dense_trajectory(path, Continuous(md, _inclination(md) + math.radians(4.0), np.full(md.shape, np.nan)))
    assert set(found.source) == {STATION, ARC}
    assert found.remarks[0].startswith("0.0 to 30.0 m: continuous inclination is +4.0 deg off")


def test_without_any_detail_nothing_differs_from_minimum_curvature():
    found = dense_trajectory(_path(), step=2.5)
    assert not found.has_detail
    assert found.differences == pytest.approx(np.zeros_like(found.differences), abs=1e-9)
    with pytest.raises(ValueError, match="above 0"):
        dense_trajectory(_path(), step=0.0)


def test_a_slide_that_turns_through_north_is_followed():
    md = np.array([0.0, 30.0])
    inclination, azimuth = np.radians([20.0, 21.0]), np.radians([355.0, 5.0])
    positions = mc.path(md, inclination, azimuth)
    path = path_of("main", North.GRID, 0.0, (md, inclination, azimuth), positions, ("tie-on", "survey"), (0, 1))
    found = dense_trajectory(path, stretches=_sheet(1))
    tangents = mc.tangent(found.inclination, found.azimuth)
    steps = np.arccos(np.clip(np.sum(tangents[1:] * tangents[:-1], axis=1), -1.0, 1.0))
    slid = found.md[1:] <= SLID
    assert steps[slid].sum() == pytest.approx(mc.dogleg(*inclination[:1], *azimuth[:1], *inclination[1:], *azimuth[1:]))
    assert steps[~slid] == pytest.approx(0.0, abs=1e-6)
