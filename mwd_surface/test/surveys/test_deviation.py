# SPDX-License-Identifier: Apache-2.0
"""Deviation of a mine hole from its design, at every station and ahead of the bit, and the files of it."""

import csv
import dataclasses
import functools
import io
import itertools
import math

import example_surveys as example
import ezdxf
import numpy as np
import openpyxl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.exports.export import FORMATS
from mwd_surface.exports.report_content import content
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.list_files.list_file import list_of
from mwd_surface.surveys.imported_list import survey_list
from mwd_surface.surveys.mine_hole import is_ahead
from mwd_surface.surveys.well import Mine, Well
from mwd_surface.trajectory.plan import straight

OPENING = (4_412_300.0, 38_512_700.0, 512.5)
MINE = Mine("Shaft 3", "4104", "niche 7", "XDA1201V 17", "2026-02-20", *OPENING)


@functools.cache
def hole(dip, azimuth, count=31, step=3.0, mine=MINE):
    """Return a list of stations along a straight hole from the opening, and its table."""
    rows = [f"{step * k},{dip},{azimuth}" for k in range(count)]
    data = "\n".join(["# north: true", "md_m,dip_up_deg,azimuth_deg", *rows]).encode()
    well = Well("H-12", convention="dip_up", north_reference="true", mine=mine)
    surveys = survey_list(list_of(data, "hole.csv"), well)
    design = straight(math.radians(95.0), math.radians(30.0), 120.0, "true", "design")
    return survey_table(surveys.along(design), example.MADE)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_a_straight_hole_leaves_the_design_by_its_angles_to_the_right_and_up(turn, rise):
    table = hole(5.0 + rise, 30.0 + turn, count=4, step=30.0)
    for row in table.deviations:
        # Distances across the design by spherical trigonometry of the two straight lines.
        i, j = math.radians(5.0 + rise), math.radians(5.0)
        right = row.measured_depth * math.cos(i) * math.sin(math.radians(turn))
        up = row.measured_depth * (math.sin(i) * math.cos(j) - math.cos(i) * math.sin(j) * math.cos(math.radians(turn)))
        assert row.right == pytest.approx(right, abs=1e-6)
        assert row.up == pytest.approx(up, abs=1e-6)
        assert row.distance == pytest.approx(math.hypot(right, up), abs=1e-6)


def test_ahead_of_the_bit_the_hole_goes_on_straight():
    rows = hole(4.0, 31.0).deviations
    ahead = [row for row in rows if is_ahead(row)]
    assert [row.measured_depth for row in ahead] == pytest.approx([100.0, 110.0, 120.0])
    assert ahead[-1].right == pytest.approx(120.0 * math.cos(math.radians(4.0)) * math.sin(math.radians(1.0)), abs=1e-6)


def test_sigmas_across_the_design_are_those_of_the_position_and_grow_ahead_of_the_bit():
    surveys = example.surveys()
    path = surveys.definitive()
    design = straight(float(path.inclination[-1]), float(path.azimuth[-1]), 2000.0, surveys.well.north_reference)
    table = survey_table(surveys.along(design), example.MADE)
    rows = table.deviations
    k = len(table.records) - 1
    whole = table.covariance[k]
    across = rows[k].sigma_right ** 2 + rows[k].sigma_up ** 2
    tangent = np.array(design.positions[1] - design.positions[0]) / 2000.0
    assert across == pytest.approx(np.trace(whole) - tangent @ whole @ tangent, rel=1e-6)
    assert rows[-1].sigma_right > rows[k].sigma_right > 0.0


def test_the_file_of_deviations_is_a_list_of_the_same_hole():
    table = hole(4.0, 31.0)
    data = FORMATS["deviation"].make(table)
    rows = list(csv.DictReader(io.StringIO(data.decode())))
    assert [row["ahead"] for row in rows[-3:]] == ["yes"] * 3
    last = rows[-4]
    positions = table.path.positions[-1]
    mine = [float(last[f"mine_{axis}_m"]) for axis in "xyz"]
    np.testing.assert_allclose(mine, np.array(OPENING) + positions * [1.0, 1.0, -1.0], atol=6e-4)
    back = list_of(data, "deviation.csv")
    np.testing.assert_allclose(back.inclination, table.path.inclination, atol=1e-6)
    np.testing.assert_allclose(back.md, table.path.md)


def test_a_list_without_a_design_says_so_and_draws_the_hole_alone():
    table = survey_table(dataclasses.replace(example.surveys(), plan=None), example.MADE)
    assert FORMATS["deviation"].make(table).startswith(b"# no row")
    drawing = ezdxf.read(io.StringIO(FORMATS["dxf"].make(table).decode()))
    assert not drawing.modelspace().query('LWPOLYLINE[layer=="DESIGN"]')


def test_plan_and_section_of_the_drawing_have_one_scale_and_do_not_overlap():
    table = hole(4.0, 31.0)
    drawing = ezdxf.read(io.StringIO(FORMATS["dxf"].make(table).decode()))
    assert drawing.header["$INSUNITS"] == 6
    lines = {
        layer: [np.array(line.get_points("xy")) for line in drawing.modelspace().query(f'LWPOLYLINE[layer=="{layer}"]')]
        for layer in ("HOLE", "DESIGN")
    }
    (plan, section), (plan_design, section_design) = lines["HOLE"], lines["DESIGN"]
    positions = table.path.positions
    np.testing.assert_allclose(plan, positions[:, [1, 0]] + [OPENING[1], OPENING[0]], atol=1e-6)
    # The horizontal length of the design is the same in both views, and so is the height of the hole in the section.
    assert np.ptp(section_design[:, 1]) == pytest.approx(120.0 * math.sin(math.radians(5.0)))
    assert np.hypot(*np.ptp(plan_design, axis=0)) == pytest.approx(120.0 * math.cos(math.radians(5.0)))
    assert section[-1, 1] - section[0, 1] == pytest.approx(positions[0, 2] - positions[-1, 2])
    assert max(section[:, 1].max(), section_design[:, 1].max()) < min(plan[:, 1].min(), plan_design[:, 1].min())


@pytest.mark.parametrize("language", ["en", "zh_CN"])
def test_the_workbook_has_the_head_of_the_mine_and_the_rod_table_in_numbers(language):
    table = hole(4.0, 31.0)
    well = dataclasses.replace(table.surveys.well, language=language)
    table = survey_table(table.surveys.configured(well, table.surveys.rules), example.MADE)
    book = openpyxl.load_workbook(io.BytesIO(FORMATS["xlsx"].make(table)))
    head = [[cell.value for cell in row] for row in book.worksheets[0].iter_rows()]
    values = {value for row in head for value in row}
    assert {"Shaft 3", "4104", "niche 7", "XDA1201V 17"} <= values
    rows = [[cell.value for cell in row] for row in book.worksheets[1].iter_rows(min_row=3)]
    assert any(row[1] == 90.0 and row[2] == pytest.approx(4.0) for row in rows)


@pytest.mark.parametrize("known", list(itertools.product([True, False], repeat=3)))
def test_an_axis_without_the_opening_has_no_mine_coordinates(known):
    given = {f"opening_{axis}": OPENING[k] for k, axis in enumerate("xyz") if known[k]}
    table = hole(4.0, 31.0, mine=Mine(**given))
    rows = list(csv.DictReader(io.StringIO(FORMATS["deviation"].make(table).decode())))
    for axis, is_known in zip("xyz", known, strict=True):
        assert all(bool(row[f"mine_{axis}_m"]) == is_known for row in rows)
    rods = next(sheet for sheet in content(table).sheets if sheet.heading.startswith("Rod table"))
    for row in rods.rows:
        assert [bool(cell) for cell in row[-3:]] == list(known)
    drawing = ezdxf.read(io.StringIO(FORMATS["dxf"].make(table).decode()))
    plan, section = (
        np.array(line.get_points("xy")) for line in drawing.modelspace().query('LWPOLYLINE[layer=="HOLE"]')
    )
    titles = [text.dxf.text for text in drawing.modelspace().query("TEXT") if "1 unit" in text.dxf.text]
    relative = [not (known[0] and known[1]), not known[2]]
    assert ["relative to the opening" in title for title in titles] == relative
    np.testing.assert_allclose(plan[0], [0.0, 0.0] if relative[0] else [OPENING[1], OPENING[0]], atol=1e-6)
    assert np.isfinite(section).all()
