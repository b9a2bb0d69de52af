# SPDX-License-Identifier: Apache-2.0
"""A well in dips: every file for people converts back to the inclinations inside, and no other number changes."""

import dataclasses
import functools
import math

import example_surveys as example
import numpy as np
import pytest
from csv_rows import rows_of

from mwd_sensors.core.angle_convention import CONVENTIONS, AngleConvention
from mwd_surface.exports.csv_tables import path_csv
from mwd_surface.exports.export import FORMATS
from mwd_surface.exports.report_content import content
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.list_files.list_file import list_of
from mwd_surface.live.plan_monitor import PlanMonitor
from mwd_surface.live.settings import PlanSettings
from mwd_surface.surveys.well import Well

DIPS = ("dip_up", "dip_down")


@functools.cache
def table(convention):
    surveys = example.surveys()
    well = dataclasses.replace(surveys.well, convention=convention)
    return survey_table(surveys.configured(well, surveys.rules), example.MADE)


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("kind", ["csv", "raw_csv"])
def test_only_the_column_of_the_vertical_angle_of_a_table_follows_the_convention(kind, convention):
    usual, told = (rows_of(FORMATS[kind].make(table(one))) for one in ("inclination", convention))
    angles = AngleConvention(convention)
    for before, after in zip(usual, told, strict=True):
        shown = after.pop(angles.column)
        inclination = float(before.pop("inclination_deg"))
        assert math.degrees(angles.inclination(math.radians(float(shown)))) == pytest.approx(inclination, abs=1e-9)
        assert after == before


@pytest.mark.parametrize("convention", DIPS)
def test_path_csv_in_dips_is_read_as_the_same_path(convention):
    made = table(convention)
    back = list_of(path_csv(made).encode(), "path.csv")
    np.testing.assert_allclose(back.inclination, made.path.inclination[: back.md.size], atol=1e-10)


@pytest.mark.parametrize("convention", DIPS)
def test_witsml_keeps_the_inclination_that_its_standard_defines(convention):
    one, other = (FORMATS["witsml"].make(table(c)).decode() for c in ("inclination", convention))
    tags = [[line for line in text.splitlines() if "<incl " in line] for text in (one, other)]
    assert tags[0] == tags[1] != []


@pytest.mark.parametrize("convention", DIPS)
def test_every_sheet_of_the_report_has_dips_where_it_had_inclinations(convention):
    angles = AngleConvention(convention)
    found = 0
    for usual, told in zip(content(table("inclination")).sheets, content(table(convention)).sheets, strict=True):
        for k, (title, unit) in enumerate(zip(usual.titles, usual.units, strict=True)):
            if title == "Inc" and unit == "deg":
                found += 1
                assert told.titles[k] == angles.heading
                for before, after in zip(usual.rows, told.rows, strict=True):
                    shown = angles.shown(math.radians(float(before[k])))
                    assert float(after[k]) == pytest.approx(math.degrees(shown), abs=0.0101)
            else:
                assert [row[k] for row in told.rows] == [row[k] for row in usual.rows]
    assert found >= 2


@pytest.mark.parametrize(
    ("convention", "title", "dip"),
    [
        ("dip_up", "dip_deg", 5.0),
        ("dip_down", "dip_deg", -5.0),
        *((convention, "hole_dip_up_deg", 5.0) for convention in CONVENTIONS),
        *((convention, "hole_dip_down_deg", -5.0) for convention in CONVENTIONS),
    ],
)
def test_a_plan_in_dips_has_the_direction_that_it_states_or_else_that_of_the_well(tmp_path, convention, title, dip):
    file = tmp_path / "plan.csv"
    file.write_text(f"md_m,{title},azi_true\n0,{dip},10\n90,{dip},10\n")
    plan = PlanMonitor.read(PlanSettings(file=str(file)), Well(convention=convention, north_reference="true"))
    np.testing.assert_allclose(np.degrees(plan.inclination), 95.0)
