# SPDX-License-Identifier: Apache-2.0
"""Every export that the project can read is the list it was made from: same place, same assumptions, same well."""

import dataclasses
import math

import example_surveys as example
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.angle_convention import CONVENTIONS
from mwd_surface.exports.csv_tables import path_csv
from mwd_surface.exports.export import FORMATS
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import list_of
from mwd_surface.list_files.remark import RemarkKind
from mwd_surface.signals.units import FIELD, METRIC
from mwd_surface.surveys.imported_list import survey_list
from mwd_surface.surveys.leg import Leg, TieOn
from mwd_surface.surveys.survey_record import Judgement
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import plan_from_list

READABLE = ("csv", "raw_csv", "las", "witsml")
# Last digits of the formats, and what they add up to along the few hundred metres of these lists, m and deg.
DEPTH, ANGLE, PLACE = 0.0051, 0.0051, 0.15


def exported(surveys, kind, leg=None):
    return FORMATS[kind].make(survey_table(surveys, example.MADE, leg=leg))


def read_back(surveys, kind, leg=None):
    return survey_list(list_of(exported(surveys, kind, leg), f"export.{kind}"))


def assert_same_list(back, surveys, leg=None):
    path, again = surveys.definitive(leg), back.definitive()
    assert again.north == path.north
    np.testing.assert_allclose(again.md, path.md, atol=DEPTH)
    np.testing.assert_allclose(np.degrees(again.inclination), np.degrees(path.inclination), atol=ANGLE)
    turned = np.degrees(again.azimuth - path.azimuth) * np.sin(path.inclination)
    np.testing.assert_allclose((turned + 180.0) % 360.0 - 180.0, 0.0, atol=ANGLE)
    np.testing.assert_allclose(again.positions, path.positions, atol=PLACE)
    assert again.assumptions == path.assumptions
    assert again.kind[0] == path.kind[0]
    own = surveys.find_leg(leg)
    while own.parent:
        own = surveys.find_leg(own.parent)
    assert back.find_leg().tie_on == own.tie_on
    assert dataclasses.replace(back.well, geomagnetic_model="") == dataclasses.replace(
        surveys.well, geomagnetic_model=""
    )
    added = [one for one in back.remarks if one not in (*surveys.remarks, *path.assumptions)]
    assert [one for one in surveys.remarks if one not in back.remarks] == []
    assert {one.kind for one in added} <= {RemarkKind.ROWS_LEFT_OUT}


@st.composite
def holes(draw):
    """Measured depth, inclination, azimuth and position of a hole that begins anywhere and never turns sharply."""
    count = draw(st.integers(3, 7))
    start = draw(st.sampled_from([0.0, 25.0, 300.0, 1850.5]))
    steps = draw(st.lists(st.floats(8.0, 40.0), min_size=count - 1, max_size=count - 1))
    md = np.round(start + np.concatenate([[0.0], np.cumsum(steps)]), 2)
    turns = draw(st.floats(-0.2, 0.3)) * np.diff(md)
    first = draw(st.floats(0.0, 100.0))
    inc = np.clip(first + np.concatenate([[0.0], np.cumsum(turns)]), 0.0, 170.0)
    azi = (draw(st.floats(0.0, 359.0)) + 0.05 * (md - start)) % 360.0
    place = draw(st.sampled_from([(0.0, 0.0, start), (40.0, -25.0, 0.9 * start)]))
    return md, np.round(inc, 2), np.round(azi, 2), place


@st.composite
def files(draw):
    """A list as others write it: with or without north, positions, map coordinates, in metres or feet."""
    md, inc, azi, place = draw(holes())
    foot = 0.3048 if draw(st.booleans()) else 1.0
    unit = "m" if foot == 1.0 else "ft"
    north = draw(st.sampled_from(["", "grid", "true", "magnetic"]))
    columns = {f"md_{unit}": md / foot, "inclination_deg": inc, f"azimuth_{north or 'deg'}": azi}
    way = draw(st.sampled_from(["angles", "depths", "offsets", "map"]))
    if way != "angles":
        positions = mc.path(md, np.radians(inc), np.radians(azi), place)
        columns["tvd_m"] = positions[:, 2]
        if way == "offsets":
            columns |= {"north_m": positions[:, 0], "east_m": positions[:, 1]}
        if way == "map":
            columns |= {"northing_m": positions[:, 0] + 6_478_300.0, "easting_m": positions[:, 1] + 431_200.0}
    rows = [",".join(columns)] + [",".join(f"{v:.4f}" for v in row) for row in zip(*columns.values(), strict=True)]
    return "\n".join(rows).encode(), Given(wellhead=(6_478_300.0, 431_200.0) if way == "map" else None)


@given(files(), st.sampled_from(READABLE), st.sampled_from([METRIC, FIELD]), st.sampled_from(CONVENTIONS))
def test_an_export_of_any_list_is_that_list_with_its_assumptions(file, kind, units, convention):
    data, said = file
    well = Well("A-1", depth_datum="RKB", datum_elevation=27.5, units=units, convention=convention)
    surveys = survey_list(list_of(data, "list.csv", said), well)
    assert_same_list(read_back(surveys, kind), surveys)


TIE_ONS = {
    "wellhead": TieOn(),
    "given": TieOn.given(280.0, math.radians(2.0), math.radians(70.0), (3.0, -4.0, 279.5)),
    "without a position": TieOn.given(280.0, math.radians(2.0), math.radians(70.0)),
}


@pytest.mark.parametrize("kind", READABLE)
@pytest.mark.parametrize("tie_on", TIE_ONS)
def test_an_export_of_a_run_has_its_tie_on_its_well_and_the_surveys_in_use(kind, tie_on):
    surveys = example.surveys(tie_on=TIE_ONS[tie_on])
    back = read_back(surveys, kind)
    assert_same_list(back, surveys)
    assert len([r for r in back.records if r.in_use]) == len([r for r in surveys.records if r.in_use])
    assert any(r.judgement != Judgement.NOT_JUDGED for r in surveys.records)


@pytest.mark.parametrize("kind", READABLE)
def test_an_export_is_read_by_its_definitive_azimuth_where_other_methods_differ(kind):
    surveys = example.surveys()
    records = []
    for record in surveys.records:
        others = tuple(dataclasses.replace(one, azimuth=one.azimuth + 0.02) for one in record.survey.azimuths)
        records.append(dataclasses.replace(record, survey=dataclasses.replace(record.survey, azimuths=others)))
    surveys = dataclasses.replace(surveys, records=tuple(records))
    assert_same_list(read_back(surveys, kind), surveys)


@pytest.mark.parametrize("kind", ["csv", "las", "witsml"])
def test_an_export_of_a_sidetrack_has_the_whole_path(kind):
    surveys = example.surveys()
    leg = "side"
    at = surveys.definitive().at(450.0)
    side = Leg(leg, TieOn(450.0, at[0], at[1], *at[2]), parent=surveys.leg)
    records = [dataclasses.replace(r, leg=leg) if r.measured_depth > 450.0 else r for r in surveys.records]
    both = dataclasses.replace(surveys, legs=(*surveys.legs, side), records=tuple(records), leg=leg)
    assert_same_list(read_back(both, kind, leg), both, leg)
    with pytest.raises(ListFileError, match="legs"):
        list_of(exported(both, "raw_csv", leg))


@given(files(), st.sampled_from(READABLE), st.sampled_from([METRIC, FIELD]))
def test_an_export_is_the_same_plan_and_offset_well_as_its_list(file, kind, units):
    data, said = file
    surveys = survey_list(list_of(data, "list.csv", said), Well(units=units))
    plan, path = plan_from_list(list_of(exported(surveys, kind))), surveys.definitive()
    np.testing.assert_allclose(plan.positions, path.positions, atol=PLACE)
    assert {one.kind for one in surveys.remarks} <= {one.kind for one in plan.remarks}


def test_the_path_for_programs_keeps_that_its_coordinates_are_assumed():
    deep = survey_list(list_of(b"md_m,inclination_deg,azimuth_true\n300,10,45\n330,12,46\n"))
    back = survey_list(list_of(path_csv(survey_table(deep, 0)).encode()))
    np.testing.assert_allclose(back.definitive().positions, deep.definitive().positions, atol=1e-6)
    assert back.definitive().assumed


def test_what_was_confirmed_of_a_list_needs_no_second_confirmation():
    sharp = b"md_m,inclination_deg,azimuth_true\n0,0,0\n30,0,0\n60,45,10\n90,46,10\n"
    surveys = survey_list(list_of(sharp, "short.csv", Given(confirm=("dogleg",))))
    for kind in READABLE:
        assert_same_list(read_back(surveys, kind), surveys)


def test_a_changed_line_about_the_list_is_refused_with_its_remedy():
    data = exported(example.surveys(), "csv")
    broken = data.replace(b'# mwd start: {"md":0.0', b'# mwd start: {"md":"0.0 m')
    assert broken != data
    with pytest.raises(ListFileError, match="mwd export"):
        list_of(broken)
