# SPDX-License-Identifier: Apache-2.0
"""Invariances of the clearance: vertical azimuths, order of wells, a moved or turned map; what is left out."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.clearance import clearance as clearance_module
from mwd_surface.clearance.clearance import ClearanceLevel, ClearanceRule, check_plausible, clearance, nearest_first
from mwd_surface.uncertainty.error_terms import ErrorReference, ErrorTool
from mwd_surface.uncertainty.position_covariance import StationErrors, UncertainWell

pytestmark = pytest.mark.slow(2)

REFERENCE = ErrorReference(math.radians(58), 51e-6, math.radians(71), math.radians(-2), math.radians(1.5))
RULE = ClearanceRule()
# Azimuths that may be printed for a vertical station.
PRINTED = np.radians([0.0, 72.0, 200.0, 324.0])
azimuths = st.floats(0.0, 2.0 * math.pi)
bounded = settings(max_examples=8, deadline=None)


def well(name, md, inc, azi, start, code="MWD+SRGM"):
    md = np.asarray(md, dtype=float)
    inc, azi = (np.array(np.broadcast_to(row, md.shape), dtype=float) for row in (inc, azi))
    errors = StationErrors([ErrorTool(code)] * md.size)
    return UncertainWell(name, md, inc, azi, mc.path(md, inc, azi, start), North.GRID, errors, REFERENCE, 0.15)


def vertical(name, azi=0.0, start=(0.0, 0.0, 0.0), end=1000.0, inc=0.0, code="MWD+SRGM"):
    return well(name, np.unique(np.append(np.arange(0.0, end, 30.0), end)), inc, azi, start, code)


def depths(length, step):
    return np.unique(np.append(np.arange(0.0, length, step), length))


@st.composite
def wells(draw, name="A", start=(0.0, 0.0, 0.0)):
    """A well that is vertical, then builds and turns, of any spacing of stations."""
    md = depths(draw(st.floats(300.0, 700.0)), draw(st.sampled_from([15.0, 30.0, 95.0])))
    build = math.radians(draw(st.floats(0.0, 4.0)) / 30.0)
    inc = np.clip((md - draw(st.floats(0.0, 200.0))) * build, 0.0, math.radians(draw(st.floats(0.0, 95.0))))
    azi = draw(azimuths) + md * math.radians(draw(st.floats(-1.0, 1.0)) / 30.0)
    return well(name, md, inc, azi % (2.0 * math.pi), start)


@st.composite
def pairs(draw):
    """Two wells that pass each other within about twenty metres somewhere along both."""
    first, second = draw(wells()), draw(wells("B"))
    places = [
        mc.interpolate(w.md, w.inclination, w.azimuth, w.positions, draw(st.floats(0.0, 1.0)) * w.md[-1])[2]
        for w in (first, second)
    ]
    apart = np.array([draw(st.floats(-12.0, 12.0)) for _ in range(3)])
    moved = second.positions + places[0] - places[1] + apart
    assume(np.linalg.norm(moved[0] - first.positions[0]) > 0.5)
    return first, dataclasses.replace(second, positions=moved)


def least(found):
    k = found.least
    return float(found.factor[k]), float(found.distance[k])


@pytest.mark.parametrize(
    ("apart", "code"),
    [(5.5, "MWD+SRGM"), pytest.param(12.0, "MWD+SRGM", marks=pytest.mark.nightly), (5.5, "GYRO-NS")],
)
def test_two_vertical_wells_are_as_near_whatever_azimuth_is_printed_and_almost_so_at_002_deg(apart, code):
    exact, steep = [], []
    start = (apart * math.cos(1.0), apart * math.sin(1.0), 0.0)
    for azimuth in PRINTED:
        # Parallel next to the vertical, so that the distance stays the same.
        for factors, inc, other in ((exact, 0.0, azimuth + 2.0), (steep, math.radians(0.02), azimuth)):
            pair = vertical("A", azimuth, inc=inc, code=code), vertical("B", other, start, inc=inc, code=code)
            factors.append(least(clearance(*pair, RULE))[0])
    assert np.ptp(exact) == 0.0
    # A fiftieth of a degree brings the first of the sag, 4 % of the allowed distance at 1000 m.
    assert max(steep) < 1.001 * exact[0]
    assert min(steep) > 0.94 * exact[0]


@bounded
@given(azimuth=azimuths, tilt=st.floats(1e-6, 0.1))
def test_every_factor_is_a_number_at_first_stations_of_any_direction(azimuth, tilt):
    """The first station errs along the hole only; across it rounding decides the sign of a variance of zero."""
    apart = (-7.0 * math.sin(azimuth), 7.0 * math.cos(azimuth), 0.0)
    pair = (vertical("A", azimuth, inc=tilt, end=90.0), vertical("B", azimuth, apart, inc=tilt, end=90.0))
    assert np.all(np.isfinite(clearance(*pair, RULE).factor))
    assert RULE.level(math.nan) == ClearanceLevel.STOP


@bounded
@given(pair=pairs(), printed=st.lists(azimuths, min_size=100, max_size=100))
def test_the_azimuth_of_vertical_stations_changes_no_clearance(pair, printed):
    other = [
        dataclasses.replace(w, azimuth=np.where(w.inclination == 0.0, printed[: w.md.size], w.azimuth)) for w in pair
    ]
    one, two = clearance(*pair, RULE), clearance(*other, RULE)
    for name in ("md", "offset_md", "distance", "allowed", "factor", "toolface", "bearing"):
        np.testing.assert_array_equal(getattr(two, name), getattr(one, name))


@bounded
@given(pair=pairs())
def test_the_nearest_place_is_the_same_from_both_wells(pair):
    assert least(clearance(pair[1], pair[0], RULE)) == pytest.approx(least(clearance(*pair, RULE)), abs=1e-9)


@pytest.mark.parametrize("bend", [1e-10, 2e-9, 1e-8, 1e-7, 1e-6, 1e-5])
def test_a_bend_too_small_to_see_changes_no_distance(bend):
    """The nearest point of an arc is found at any radius, also where the stations of a list are rounded."""
    md = np.arange(0.0, 601.0, 30.0)
    inc = np.full(md.size, math.radians(5.0))
    straight = well("B", md, inc, 2.0, (9.0, -21.0, -20.0))
    bent = well("B", md, inc + bend * (np.arange(md.size) % 2), 2.0, (9.0, -21.0, -20.0))
    one, two = (clearance(vertical("A", end=600.0), other, RULE) for other in (straight, bent))
    np.testing.assert_allclose(np.interp(one.md, two.md, two.distance), one.distance, atol=0.01)
    np.testing.assert_allclose(np.interp(one.md, two.md, two.factor), one.factor, atol=0.005)


@bounded
@given(pair=pairs(), north=st.floats(-2000.0, 2000.0), east=st.floats(-2000.0, 2000.0))
def test_wellheads_that_move_together_change_no_clearance(pair, north, east):
    moved = [dataclasses.replace(w, positions=w.positions + np.array([north, east, 0.0])) for w in pair]
    want = least(clearance(*pair, RULE))
    assume(want[1] > 0.01)
    assert least(clearance(*moved, RULE)) == pytest.approx(want, rel=1e-5, abs=1e-5)


@bounded
@given(pair=pairs(), turn=st.floats(-math.pi, math.pi))
def test_a_map_that_is_turned_with_its_grid_changes_no_clearance(pair, turn):
    """
    Azimuths, wellheads and convergence change together, so that holes and field stay where they are.

    A hole that is turned against the field of the Earth has other errors. Where the axes cross, the direction to the
    other well, along which the rule takes the errors, is not defined; the factor is below zero then.
    """
    c, s = math.cos(turn), math.sin(turn)
    mat = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    reference = dataclasses.replace(REFERENCE, convergence=REFERENCE.convergence + turn)
    other = [
        dataclasses.replace(w, azimuth=w.azimuth - turn, positions=w.positions @ mat.T, reference=reference)
        for w in pair
    ]
    one, two = clearance(*pair, RULE), clearance(*other, RULE)
    assume(least(one)[1] > 0.01)
    assert least(two) == pytest.approx(least(one), rel=1e-5, abs=1e-5)


# Two curved wells that cross between stations that lie far apart.
CURVED = (
    well(
        "A", depths(600.0, 95.0), np.minimum(depths(600.0, 95.0) * 0.00232711, 0.83302107), 2.55319698, (0.0, 0.0, 0.0)
    ),
    well(
        "B",
        depths(573.93059962, 30.0),
        np.clip((depths(573.93059962, 30.0) - 173.384) * 0.00208082, 0.0, 0.50614548),
        0.75,
        (-86.57824377, -56.42600982, -396.79935704),
    ),
)


@bounded
@example(pair=CURVED, step=7.0)
@given(pair=pairs(), step=st.sampled_from([7.0, 12.0, 20.0]))
def test_the_least_factor_does_not_depend_on_the_step_of_the_search(pair, step):
    want = least(clearance(*pair, RULE))
    assume(want[1] > 0.01)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clearance_module, "_STEP", step)
        got = least(clearance(*pair, RULE))
    assert got[0] == pytest.approx(want[0], rel=5e-3, abs=5e-3)


def test_the_order_of_offset_wells_changes_nothing():
    others = [vertical(name, start=(apart, 0.0, 0.0)) for name, apart in (("B", 9.0), ("C", 7.0), ("D", 30.0))]
    found = [clearance(vertical("A"), other, RULE) for other in others]
    for order in itertools.permutations(found):
        assert [one.name for one in nearest_first(order)] == ["C", "B", "D"]


@pytest.mark.parametrize("depth", [985.0, 15.0])
def test_a_crossing_in_the_first_or_last_interval_is_found(depth):
    """The hole that crosses is 2 m away between two stations at 15 m from it."""
    crossing = well("B", depths(400.0, 30.0), math.pi / 2, 0.0, (-195.0, 2.0, depth))
    for pair in ((vertical("A"), crossing), (crossing, vertical("A"))):
        factor, distance = least(clearance(*pair, RULE))
        assert distance == pytest.approx(2.0, abs=0.05)
        assert factor < 0.9


def test_a_shallower_well_is_compared_down_to_its_end_from_both_sides():
    deep, shallow = vertical("A"), vertical("B", start=(6.0, 0.0, 0.0), end=400.0)
    found = clearance(deep, shallow, RULE)
    assert not found.not_compared
    assert found.offset_md.max() == pytest.approx(400.0)
    assert found.distance[-1] == pytest.approx(math.hypot(600.0, 6.0))
    assert least(clearance(shallow, deep, RULE)) == pytest.approx(least(found))


def test_what_lies_above_the_first_station_is_said_to_be_left_out():
    late = well("B", np.arange(300.0, 1001.0, 30.0), 0.0, 0.0, (6.0, 0.0, 300.0))
    found = clearance(vertical("A"), late, RULE)
    assert [dataclasses.astuple(part)[:3] for part in found.not_compared] == [("B", 0.0, 300.0)]
    assert not found.not_compared[0].shared
    assert "B was not compared from 0 to 300 m" in found.not_compared[0].remark().text
    assert found.between(500.0, 600.0).not_compared == found.not_compared
    both = clearance(late, vertical("A"), RULE)
    assert [part.well for part in both.not_compared] == ["B"]
    side = clearance(vertical("A"), dataclasses.replace(vertical("C"), name="C"), RULE, shared_to=300.0)
    assert [(part.well, part.to_md) for part in side.not_compared if part.shared] == [("A", 300.0), ("C", 300.0)]


def test_wells_that_cannot_be_where_they_are_said_to_be_are_an_error_to_confirm():
    far = vertical("B", start=(0.0, 655e3, 0.0))
    with pytest.raises(ValueError, match=r"B starts 655 km from the wellhead: .* confirm .* rule.farthest_km"):
        clearance(vertical("A"), far, RULE)
    near, other = vertical("A", start=(-9e3, 0.0, 0.0)), vertical("B", start=(9e3, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"B lies 18 km from A: .* rule.farthest_km"):
        clearance(near, other, RULE)
    confirmed = clearance(vertical("A"), far, ClearanceRule(farthest_km=1000.0))
    assert confirmed.level == ClearanceLevel.CLEAR


def test_an_impossible_dogleg_is_an_error_to_confirm():
    md = np.arange(0.0, 301.0, 30.0)
    inc = np.where(md == 150.0, math.radians(40.0), 0.0)
    bent = well("B", md, inc, 1.0, (20.0, 0.0, 0.0))
    for pair in ((vertical("A"), bent), (bent, vertical("A"))):
        with pytest.raises(ValueError, match=r"B turns 40 deg between 120 and 150 m .* rule.largest_dogleg_deg_30m"):
            clearance(*pair, RULE)
    assert clearance(vertical("A"), bent, ClearanceRule(largest_dogleg_deg_30m=45.0)).factor.size
    # What is planned below the last survey may begin with a corner.
    assert clearance(dataclasses.replace(bent, surveyed=130.0), vertical("A"), RULE).factor.size
    # Two stations half a metre apart that differ by a degree are noise; one station has no dogleg.
    check_plausible(well("C", [0.0, 100.0, 100.5, 200.0], [0.0, 0.02, 0.04, 0.05], 1.0, (0.0, 0.0, 0.0)), RULE)
