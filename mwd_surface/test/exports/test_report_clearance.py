# SPDX-License-Identifier: Apache-2.0
"""Offset wells in the report: levels, the part ahead, and a file that cannot be used."""

import dataclasses

import example_surveys as example
import numpy as np
import pytest

from mwd_surface.clearance.clearance import ClearanceLevel
from mwd_surface.clearance.offset_wells import read_offset_wells, well_clearance
from mwd_surface.exports.export import FORMATS
from mwd_surface.exports.report_clearance import clearance_sections
from mwd_surface.exports.report_section import GOOD, REJECT
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.plots.clearance_plots import plan_view
from mwd_surface.trajectory.plan import read_plan

WELLS = """
wells:
  - {name: A-2, file: straight.csv, north_m: 900.0, planned: true}
  - {name: A-3, file: beside.csv, north_m: -20.0}
  - {name: A-4, file: lost.csv, north_m: 9.0}
ahead_m: 200.0
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "straight.csv").write_text("md_m,inc_deg,azi_grid_deg\n0,0,0\n300,0,0\n900,0,0\n")
    rows = "\n".join(f"{30 * k},{max(0.0, 4.0 * (k - 11))},79" for k in range(30))
    (tmp_path / "beside.csv").write_text(f"md_m,inc_deg,azi_grid_deg\n{rows}\n")
    (tmp_path / "wells.yaml").write_text(WELLS)
    return tmp_path


def surveys(folder):
    return example.surveys(dataclasses.replace(example.WELL, offset_wells=str(folder / "wells.yaml")))


@pytest.mark.slow
def test_each_well_has_a_line_for_the_whole_path_and_one_ahead(folder):
    (section,), remarks = clearance_sections(surveys(folder), read_plan(folder / "beside.csv", "grid"))
    rows = section.sheets[0].rows
    assert [row[:2] for row in rows] == [("A-3", "whole"), ("A-3", "ahead"), ("A-2", "whole"), ("A-2", "ahead")]
    assert section.sheets[0].tints[0, 8] == REJECT
    assert section.sheets[0].tints[2, 8] == GOOD
    assert float(rows[1][2]) >= 630.0
    assert "below 1.25" in section.text[0] or "below 1.25 a warning" in section.text[0]
    assert any("A-4" in text for text in remarks)


@pytest.mark.slow
def test_the_plan_view_shows_each_compared_well_and_joins_the_nearest_points(folder):
    near = well_clearance(surveys(folder), read_offset_wells(folder / "wells.yaml"), None)
    (axes,) = plan_view(near).axes
    lines = {line.get_label(): line.get_xydata() for line in axes.get_lines()}
    assert {one.name for one in near.found} <= set(lines)
    (last,) = lines["last survey"]
    assert axes.get_xlim()[0] <= last[0] <= axes.get_xlim()[1]
    assert axes.get_ylim()[0] <= last[1] <= axes.get_ylim()[1]
    joins = [xy for label, xy in lines.items() if len(xy) == 2 and label.startswith("_")]
    assert len(joins) == len(near.found)
    for one, (here, there) in zip(near.found, joins, strict=True):
        assert np.hypot(*(here - there)) <= one.distance[one.least] + 1e-6
        # Both ends lie in the picture.
        for place in (here, there):
            assert axes.get_xlim()[0] <= place[0] <= axes.get_xlim()[1]
            assert axes.get_ylim()[0] <= place[1] <= axes.get_ylim()[1]


def test_the_position_ahead_grows_worse_from_the_last_survey_over_the_bit_along_the_plan(folder):
    (section,), _ = clearance_sections(surveys(folder), read_plan(folder / "beside.csv"))
    rows = section.sheets[1].rows
    kinds = [row[-1] for row in rows]
    assert kinds[:2] == ["surveyed", "bit"]
    assert set(kinds[2:]) == {"ahead"}
    axes = [float(row[7]) for row in rows]
    assert axes == sorted(axes)


@pytest.mark.slow
def test_the_report_has_the_section_and_its_pictures(folder):
    sections, _ = clearance_sections(surveys(folder), None)
    text = FORMATS["html"].make(survey_table(surveys(folder), example.MADE, sections=sections)).decode()
    for words in ("Offset wells", "Clearance to offset wells", "Travelling cylinder", "A-3", "SPE 187073"):
        assert words in text


def test_without_offset_wells_there_is_no_section_and_a_bad_file_is_a_remark(folder):
    assert clearance_sections(example.surveys(), None) == ((), ())
    (folder / "wells.yaml").write_text("wells: [{name: A}]")
    sections, remarks = clearance_sections(surveys(folder), None)
    assert sections == ()
    assert "file" in remarks[0]


def test_the_level_looks_from_the_last_survey_on_only(folder):
    """Beside the first stations, away from the last ones."""
    rows = "\n".join(f"{30 * k},0,0" for k in range(20))
    (folder / "beside.csv").write_text(f"md_m,inc_deg,azi_grid_deg\n{rows}\n")
    near = well_clearance(surveys(folder), read_offset_wells(folder / "wells.yaml"))
    assert near.found[0].level == ClearanceLevel.STOP
    assert near.level == ClearanceLevel.CLEAR
    assert near.ahead()[0].md[0] >= near.surveyed
