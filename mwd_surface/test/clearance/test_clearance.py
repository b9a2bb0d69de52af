# SPDX-License-Identifier: Apache-2.0
"""The separation rule against the ISCWSA's standard set of well paths, sidetracks, levels, and what it refuses."""

import dataclasses
import math

import numpy as np
import pytest

from mwd_estimation.core.north import North
from mwd_sensors.core import minimum_curvature as mc
from mwd_surface.clearance.clearance import ClearanceLevel, ClearanceRule, clearance, nearest_first
from mwd_surface.uncertainty.error_terms import ErrorReference, ErrorTool, error_terms
from mwd_surface.uncertainty.position_covariance import StationErrors, UncertainWell, covariance_of

# ISCWSA, "Standard Set of Wellpaths for Evaluation of Clearance Scenarios", release 4, 2017: field and rule.
REFERENCE = ErrorReference(math.radians(60.0), 50e-6, math.radians(70.0), 0.0)
RULE = ClearanceRule(k=3.5, surface_margin_m=0.3, projection_sigma_m=0.5)
INCH = 0.0254


class AsPrinted(UncertainWell):
    """Well whose errors are taken at the azimuths that its list prints: the set prints 0 in its vertical parts."""

    def covariance(self):
        stations = self.md, self.inclination, self.azimuth
        return covariance_of(error_terms(stations, self.errors.tools, self.reference), self.md.size)


def well(name, md, inc_deg, azi_deg, start, diameter, code="ISCWSA MWD Rev4"):
    md = np.asarray(md, dtype=float)
    inc, azi = np.radians(np.broadcast_to(inc_deg, md.shape)), np.radians(np.broadcast_to(azi_deg, md.shape))
    tools = [ErrorTool(code)] * md.size
    positions = mc.path(md, inc, azi, start)
    errors = StationErrors(tools)
    return UncertainWell(name, md, inc, azi, positions, North.TRUE, errors, REFERENCE, 0.5 * diameter * INCH)


def depths(end):
    return np.unique(np.append(np.arange(0.0, end, 30.0), (1.0, end)))


def built(md, start, most):
    return np.clip((md - start) / 15.0, 0.0, most)


def drilled(start=(0.0, 0.0, 0.0), diameter=36.0):
    """The reference well of the set: vertical to 1000 m, 2 deg per 30 m to 85 deg, at the end horizontal."""
    md = depths(2940.0)
    inc = np.where(md < 2775.0, built(md, 1000.0, 85.0), np.minimum(86.0 + (md - 2790.0) / 15.0, 90.0))
    return well("reference", md, inc, np.where(inc > 0.0, 180.0, 0.0), start, diameter)


def offset(number):
    if number == 1:
        return dataclasses.replace(drilled((0.0, 100.0, 0.0), 24.0), name="01")
    ends = {5: 2655.0, 8: 2450.0, 9: 2200.0, 11: 2590.0}
    md = depths(ends[number])
    shape = {
        5: (built(md, 1000.0, 77.0), np.where(md > 1000.0, 145.0, 0.0), (-50.0, -500.0, 0.0)),
        8: (np.clip((md - 1000.0) / 10.0, 0.0, 70.0), 90.0, (-500.0, -900.0, 0.0)),
        9: (np.zeros(md.size), 0.0, (-1000.0, 0.0, 0.0)),
        11: (built(md, 1040.5, 90.0), 90.0, (-1400.0, -1000.0, 0.0)),
    }[number]
    return well(f"{number:02d}", md, shape[0], shape[1], shape[2], 24.0)


PUBLISHED = {
    1: {0.0: 56.536, 330.0: 29.0099, 1050.0: 10.484, 1770.0: 4.7103, 2490.0: 1.9752, 2940.0: 1.4002},
    5: {
        690.0: 78.7652,
        1410.0: 31.1115,
        2130.0: 2.0999,
        2190.0: 1.3146,
        2220.0: 1.1954,
        2310.0: 1.4341,
        2490.0: 2.9384,
    },
    8: {1410.0: 15.0537, 1770.0: 4.1199, 1890.0: 1.6444, 1920.0: 1.2721, 1950.0: 1.4023, 2490.0: 10.6105},
    9: {1050.0: 105.4473, 2130.0: 21.5094, 2460.0: 1.7554, 2490.0: 0.0098, 2520.0: 1.6051},
    11: {1050.0: 36.9931, 2490.0: 7.7183, 2850.0: 0.7924, 2880.0: 0.2262, 2910.0: 0.3269},
}


@pytest.mark.parametrize("number", PUBLISHED)
def test_the_standard_set_of_well_paths_is_reproduced(number):
    """Positions of the set are rounded to a centimetre; its errors are those of MWD revision 4."""
    as_printed = [AsPrinted(**vars(one)) for one in (drilled(), offset(number))]
    found = clearance(*as_printed, RULE)
    for md, factor in PUBLISHED[number].items():
        got = found.factor[np.argmin(np.abs(found.md - md))]
        assert got == pytest.approx(factor, rel=4e-3, abs=6e-3), md


@pytest.mark.parametrize("number", PUBLISHED)
def test_no_factor_is_larger_than_that_of_the_standard_set(number):
    """The errors of a vertical part point along the hole below it, which the set's azimuth 0 does not; 3 % at most."""
    found = clearance(drilled(), offset(number), RULE)
    for md, factor in PUBLISHED[number].items():
        got = found.factor[np.argmin(np.abs(found.md - md))]
        assert 0.97 * factor - 6e-3 < got < 1.004 * factor + 6e-3, md


def test_between_stations_the_least_factor_is_found():
    found = clearance(drilled(), offset(11), RULE)
    k = found.least
    assert found.factor[k] < 0.2
    assert 2880.0 < found.md[k] < 2910.0
    assert found.level == ClearanceLevel.STOP
    assert "11 is " in found.sentence()
    assert "below 1" in found.sentence()


def test_the_allowed_distance_is_where_the_factor_is_one():
    found = clearance(drilled(), offset(1), RULE)
    radii = 0.5 * (36.0 + 24.0) * INCH + RULE.surface_margin_m
    np.testing.assert_allclose((found.distance - radii) / (found.allowed - radii), found.factor, rtol=1e-9)


def test_the_direction_to_the_other_well_is_told_from_high_side_and_from_north():
    found = clearance(drilled(), offset(1), RULE)
    end = np.argmax(found.md)
    # The well runs south, the other one lies 100 m to the east: to the left of the hole.
    assert found.toolface[end] == pytest.approx(1.5 * math.pi, abs=1e-3)
    assert found.bearing[end] == pytest.approx(0.5 * math.pi, abs=1e-3)
    assert found.distance[end] == pytest.approx(100.0, abs=1e-6)


def test_a_sidetrack_is_judged_below_its_kick_off_as_the_standard_set_does():
    """The set's offset 10 leaves the reference well at 900 m with 3 deg per 30 m; its first two factors."""
    md = np.arange(900.0, 1291.0, 30.0)
    side = well("10", md, (md - 900.0) / 10.0, np.where(md > 900.0, 130.0, 180.0), (0.0, 0.0, 900.0), 24.0)
    found = clearance(drilled(), side, RULE, shared_to=900.0)
    assert found.md[0] == 900.0
    assert found.factor[0] == pytest.approx(-0.6068, abs=1e-3)
    assert found.factor[np.argmin(np.abs(found.md - 930.0))] == pytest.approx(-0.1592, abs=2e-3)


def test_two_wells_in_one_place_are_asked_for_their_wellheads():
    same = dataclasses.replace(drilled(), name="A-2")
    with pytest.raises(ValueError, match=r"A-2 lies in the same place as reference down to 2940 m: give the place"):
        clearance(drilled(), same, RULE)
    with pytest.raises(ValueError, match="not on its path"):
        clearance(drilled(), same, RULE, shared_to=5000.0)


def test_wells_from_other_norths_are_refused():
    with pytest.raises(ValueError, match="azimuths are from grid north, but those of the well from true north"):
        clearance(drilled(), dataclasses.replace(offset(1), north=North.GRID), RULE)


def test_levels_follow_the_factor():
    assert [RULE.level(f) for f in (-0.2, 0.99, 1.0, 1.24, 1.25)] == [
        ClearanceLevel.STOP,
        ClearanceLevel.STOP,
        ClearanceLevel.WARNING,
        ClearanceLevel.WARNING,
        ClearanceLevel.CLEAR,
    ]
    found = nearest_first([clearance(drilled(), offset(n), RULE) for n in (1, 11, 5)])
    assert [c.name for c in found] == ["11", "05", "01"]
    assert found[2].between(3000.0, 4000.0) is None
    assert found[2].between(0.0, 500.0).level == ClearanceLevel.CLEAR


def test_a_plan_of_two_stations_serves_as_an_offset_well():
    long = well("plan", [0.0, 3000.0], [0.0, 0.0], [0.0, 0.0], (-1000.0, 20.0, 0.0), 24.0)
    found = clearance(drilled(), long, RULE)
    assert found.distance.min() == pytest.approx(20.0, abs=1e-3)
