# SPDX-License-Identifier: Apache-2.0
"""Closure of a mine hole on a surveyed point, and its branches: paths, tables, drawing and report."""

import csv
import dataclasses
import functools
import io
import math

import example_surveys as example
import ezdxf
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_sensors.core.settings import from_mapping
from mwd_surface.exports.export import FORMATS
from mwd_surface.exports.report_content import content
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.live.survey_book import _uncertain
from mwd_surface.surveys.leg import Leg, TieOn
from mwd_surface.surveys.mine_hole import CONSISTENT, INCONSISTENT, UNKNOWN, branches, legs_of, others
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well import Mine
from mwd_surface.trajectory.plan import straight

OPENING = (4_196_300.0, 544_100.0, 512.5)
COUNT, STEP = 10, 9.0


@functools.cache
def hole(**mine):
    """Return the list of a hole of 90 m that rises gently and turns right, with a station each 9 m."""
    given_opening = dict(zip(("opening_x", "opening_y", "opening_z"), OPENING, strict=True))
    well = dataclasses.replace(
        example.WELL,
        convention="dip_up",
        section_azimuth_deg=None,
        sensor_to_bit=None,
        mine=Mine(**{**given_opening, **mine}),
    )
    start = TieOn.given(0.0, math.radians(86.0), math.radians(75.0))
    surveys = SurveyList(well=well, legs=(Leg(tie_on=start),))
    for k in range(1, COUNT + 1):
        surveys = surveys.add(example.survey(k, 86.0 - 0.2 * k, 75.0 + 0.4 * k), STEP * k, 0.4)
    design = straight(math.radians(86.0), math.radians(75.0), 100.0, well.north_reference, "design")
    return surveys.along(design)


def with_point(surveys, position, **changes):
    """Return the list with a surveyed point at a position north, east, down from the opening."""
    x, y, z = OPENING
    north, east, down = map(float, position)
    point = {"closure_x": x + north, "closure_y": y + east, "closure_z": z - down, **changes}
    well = dataclasses.replace(surveys.well, mine=dataclasses.replace(surveys.well.mine, **point))
    return surveys.configured(well, surveys.rules)


def closure_of(surveys, leg=None):
    return survey_table(surveys, example.MADE, leg=leg).closure


def axes_at(surveys, depth):
    """Return right, up and along the hole by differences of its path and the horizontal, shape (3, 3)."""
    path = surveys.definitive()
    along = path.at(depth + 0.01)[2] - path.at(depth - 0.01)[2] if depth < path.md[-1] else None
    if along is None:
        along = path.positions[-1] - path.at(depth - 0.01)[2]
    along = along / np.linalg.norm(along)
    right = np.cross([0.0, 0.0, 1.0], along)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(along, right) * -1.0, along])


@settings(max_examples=25)
@given(
    st.floats(1.0, STEP * COUNT - 0.1),
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)
def test_a_point_beside_the_path_is_missed_by_its_displacement_in_the_axes_of_the_hole(depth, away):
    surveys = hole()
    axes = axes_at(surveys, depth)
    point = surveys.definitive().at(depth)[2] + np.array(away) @ axes
    found = closure_of(with_point(surveys, point, closure_depth=depth))
    np.testing.assert_allclose([found.right, found.up, found.along], -np.array(away), atol=2e-3)
    assert found.distance == pytest.approx(float(np.linalg.norm(away)), abs=1e-6)


def test_a_point_on_the_path_closes_and_one_far_off_does_not():
    surveys = hole()
    end = surveys.definitive().positions[-1]
    exact = closure_of(with_point(surveys, end))
    assert exact.verdict == CONSISTENT
    assert exact.measured_depth == pytest.approx(STEP * COUNT)
    assert exact.probability == pytest.approx(1.0)
    assert exact.sigma_right > exact.sigma_along > 0.0
    far = closure_of(with_point(surveys, np.add(end, [0.0, 0.0, 6.0 * math.hypot(exact.sigma_up, 0.05)])))
    assert far.verdict == INCONSISTENT
    assert far.up > 0.0


def test_points_drawn_from_the_errors_of_path_and_point_are_consistent_as_often_as_stated():
    surveys = hole()
    table = survey_table(surveys, example.MADE)
    end, covariance = table.path.positions[-1], table.covariance[-1]
    rng = np.random.default_rng(3)
    errors = rng.multivariate_normal(np.zeros(3), covariance + 0.05**2 * np.eye(3), 40)
    # The axes of the hole only rotate the error, so the probability is that of the error itself.
    found = [closure_of(with_point(surveys, end + error)).probability for error in errors]
    np.testing.assert_allclose(np.sort(found), (np.arange(40) + 0.5) / 40, atol=0.22)


def test_the_closure_does_not_depend_on_where_the_stations_lie():
    surveys = hole()
    at_station = STEP * 5
    results = []
    for depth in (at_station - 0.002, at_station, at_station + 0.002):
        point = surveys.definitive().at(depth)[2] + [0.1, 0.2, -0.1]
        results.append(closure_of(with_point(surveys, point, closure_depth=depth)))
    for field in ("right", "up", "along", "sigma_right", "sigma_up", "probability"):
        values = [getattr(one, field) for one in results]
        np.testing.assert_allclose(values, values[1], rtol=0.02, atol=1e-3, err_msg=field)


def test_moving_the_mine_coordinates_of_opening_and_point_together_changes_nothing():
    surveys = hole()
    point = surveys.definitive().positions[-1] + [0.3, 0.1, 0.2]
    one = with_point(surveys, point)
    mine = one.well.mine
    fields = [f"{name}_{axis}" for name in ("opening", "closure") for axis in "xyz"]
    moved = dataclasses.replace(mine, **{name: getattr(mine, name) + 1000.0 for name in fields})
    other = one.configured(dataclasses.replace(one.well, mine=moved), one.rules)
    got, expected = (dataclasses.astuple(closure_of(each)) for each in (one, other))
    assert got[0] == expected[0]
    np.testing.assert_allclose(got[1:11], expected[1:11], atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"closure_z": None}, "needed"),
        ({"opening_x": None}, "needed"),
        ({"closure_depth": 200.0}, "does not reach"),
        ({"closure_leg": "nowhere"}, "no leg"),
    ],
)
def test_a_closure_that_cannot_be_computed_says_why(changes, word):
    surveys = with_point(hole(), hole().definitive().positions[-1], **changes)
    found = closure_of(surveys)
    assert found.verdict == UNKNOWN
    assert word in found.note
    assert math.isnan(found.distance)
    sheet = next(s for s in content(survey_table(surveys, example.MADE)).sheets if s.heading.startswith("Closure"))
    assert sheet.rows[0][-1] == UNKNOWN


def test_a_hole_without_a_point_has_no_closure():
    assert closure_of(hole()) is None
    headings = [sheet.heading for sheet in content(survey_table(hole(), example.MADE)).sheets]
    assert not any(heading.startswith(("Closure", "Branches")) for heading in headings)


@functools.cache
def branched():
    """Return a hole with a branch at 40 m that turns to the left."""
    surveys = hole().sidetracked("B1", 40.0)
    for k in range(1, 5):
        surveys = surveys.add(example.survey(COUNT + k, 86.0, 74.0 - 2.0 * k), 40.0 + STEP * k, 0.4)
    return surveys


def test_a_branch_begins_on_the_path_of_its_parent_and_shares_its_deviation():
    surveys = branched()
    main = survey_table(surveys, example.MADE, leg="main").deviations
    branch = survey_table(surveys, example.MADE, leg="B1").deviations
    shared = [row for row in branch if row.leg == "main" and row.kind == "survey"]
    assert [row.measured_depth for row in shared] == [STEP * k for k in range(1, 5)]
    for row in shared:
        twin = next(one for one in main if one.station == row.station)
        assert (row.right, row.up, row.x, row.y, row.z) == pytest.approx((twin.right, twin.up, twin.x, twin.y, twin.z))
    assert {row.leg for row in branch if row.measured_depth > 40.0} == {"B1"}
    assert branch[-1].right < main[-1].right
    (one,) = branches(surveys)
    assert (one.name, one.parent, one.measured_depth, one.end) == ("B1", "main", 40.0, 40.0 + 4 * STEP)
    np.testing.assert_allclose(one.position, surveys.definitive("main").at(40.0)[2])


def test_the_parts_of_a_branched_hole_join_to_the_whole():
    surveys = branched().sidetracked("B2", 60.0, "B1")
    surveys = surveys.add(example.survey(30, 80.0, 70.0), 70.0, 0.4)
    for name in ("main", "B1", "B2"):
        path = surveys.definitive(name)
        parts = dict(others(surveys, path))
        assert set(parts) == {"main", "B1", "B2"} - {name}
        # Each part begins on the path drawn, or on another part, and ends where its leg ends.
        ends = [path, *(surveys.definitive(other) for other in parts)]
        for other, points in parts.items():
            np.testing.assert_allclose(points[-1], surveys.definitive(other).positions[-1])
            nearest = min(
                np.linalg.norm(each.at(min(depth, each.md[-1]))[2] - points[0])
                for each in ends
                for depth in (40.0, 60.0)
            )
            assert nearest < 1e-9
        assert legs_of(surveys, path)[-1] == name


def test_a_branch_that_leaves_above_the_beginning_of_its_parent_leaves_the_leg_above():
    surveys = branched().sidetracked("B2", 20.0, "B1").add(example.survey(30, 80.0, 70.0), 30.0, 0.4)
    path = surveys.definitive("B2")
    assert legs_of(surveys, path)[-1] == "B2"
    assert set(legs_of(surveys, path)[:-2]) == {"main"}
    parts = dict(others(surveys, path))
    # The path leaves the main leg at 20 m; the other branch still begins at 40 m.
    np.testing.assert_allclose(parts["main"][0], surveys.definitive("main").at(20.0)[2], atol=1e-9)
    np.testing.assert_allclose(parts["B1"][0], surveys.definitive("main").at(40.0)[2], atol=1e-9)


def test_the_files_of_a_branched_hole_name_its_legs():
    surveys = with_point(branched(), branched().definitive("main").positions[-1], closure_leg="main")
    table = survey_table(surveys, example.MADE)
    rows = list(csv.DictReader(io.StringIO(FORMATS["deviation"].make(table).decode())))
    assert {row["leg"] for row in rows} == {"main", "B1"}
    drawing = ezdxf.read(io.StringIO(FORMATS["dxf"].make(table).decode()))
    space = drawing.modelspace()
    assert len(space.query('LWPOLYLINE[layer=="BRANCHES"]')) == 2
    assert len(space.query('LINE[layer=="SURVEYED_POINT"]')) == 4
    assert [text.dxf.text for text in space.query("TEXT")].count("main") == 2
    # The other leg is drawn to its end, in the plan in mine coordinates.
    plan = np.array(space.query('LWPOLYLINE[layer=="BRANCHES"]')[0].get_points("xy"))
    north, east, _ = surveys.definitive("main").positions[-1]
    np.testing.assert_allclose(plan[-1], [OPENING[1] + east, OPENING[0] + north], atol=1e-6)
    sheets = {sheet.heading: sheet for sheet in content(table).sheets}
    assert sheets["Branches"].rows[0][:3] == ("B1", "main", "40.00")
    # The point is that of the main leg, also while the branch is printed.
    closure = sheets["Closure on the surveyed point"]
    assert closure.rows[0][0] == "main"
    assert closure.rows[0][-1] == CONSISTENT
    assert "Leg" in next(sheet for heading, sheet in sheets.items() if heading.startswith("Rod table")).titles


def test_the_page_gets_branches_and_closure_of_a_mine_hole_alone():
    surveys = with_point(branched(), branched().definitive().positions[-1])
    _, parts = _uncertain(surveys, surveys.definitive(), example.MADE)
    assert [one.name for one in parts["branches"]] == ["B1"]
    assert parts["closure"].verdict == CONSISTENT
    plain = example.surveys().sidetracked("ST1", 400.0)
    _, parts = _uncertain(plain, plain.definitive(), example.MADE)
    assert parts == {"deviation": (), "branches": (), "closure": None}


@pytest.mark.parametrize("azimuth", [0.0, 45.0, 90.0])
@pytest.mark.parametrize("missed", [0, 1, 2])
def test_a_point_at_the_opening_of_a_level_hole_is_closed_on_by_its_own_accuracy(azimuth, missed):
    """There the path has no error across the hole, so that only the accuracy of the point explains one."""
    level = hole()
    start = TieOn.given(0.0, math.radians(90.0), math.radians(azimuth))
    surveys = SurveyList(well=level.well, legs=(Leg(tie_on=start),))
    surveys = surveys.add(example.survey(1, 90.0, azimuth), STEP, 0.4)
    least = with_point(surveys, 2.0 * np.eye(3)[missed], closure_depth=0.0, closure_sigma=1e-3)
    assert closure_of(least).verdict == INCONSISTENT
    with pytest.raises(ValueError, match="closure_sigma"):
        from_mapping(Mine, {"closure_sigma": 0.0})
