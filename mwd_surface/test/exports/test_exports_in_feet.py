# SPDX-License-Identifier: Apache-2.0
"""Exports of a well in field units, with inclinations or dips: the same lengths in feet, and no length in two units."""

import functools
import io
import math
import re

import example_surveys as example
import lasio
import openpyxl
import pytest
from csv_rows import rows_of

from mwd_sensors.core.angle_convention import CONVENTIONS
from mwd_surface.exports.csv_tables import path_csv
from mwd_surface.exports.export import FORMATS
from mwd_surface.exports.survey_table import survey_table
from mwd_surface.list_files.list_file import list_of
from mwd_surface.signals.units import FIELD, METRIC
from mwd_surface.trajectory.plan import straight

FOOT = 0.3048
TO_METRIC = {"ft": ("m", FOOT), "deg/100 ft": ("deg/30 m", 30.0 / 30.48), "deg/100ft": ("deg/30 m", 30.0 / 30.48)}


@functools.cache
def tables(convention):
    """Return the table of a planned well in metric and in field units."""
    design = straight(math.radians(30.0), math.radians(75.0), 900.0, "grid", "design")
    found = []
    for units in (METRIC, FIELD):
        surveys = example.table(well={"units": units, "convention": convention}).surveys.along(design)
        found.append(survey_table(surveys, example.MADE, stretches=example.stretches(), bit_depth=640.0))
    return found


def made(table, kind):
    return FORMATS[kind].make(table)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_the_workbook_in_feet_has_the_lengths_of_the_workbook_in_metres(convention):
    metric, field = (openpyxl.load_workbook(io.BytesIO(made(table, "xlsx"))) for table in tables(convention))
    compared = 0
    # The name of a sheet may have a length in it.
    for pages in zip(metric.worksheets[1:], field.worksheets[1:], strict=True):
        rows, in_feet = ([[cell.value for cell in row] for row in page.iter_rows()] for page in pages)
        top = next((k for k, row in enumerate(in_feet) if sum(isinstance(one, str) for one in row) > 1), None)
        if top is None:
            continue
        for j, title in enumerate(in_feet[top]):
            words, _, unit = (title or "").rpartition(", ")
            name_of, factor = TO_METRIC.get(unit, ("", 1.0))
            assert not unit.startswith("m ") or "grid" in unit
            if not name_of:
                continue
            assert rows[top][j] == f"{words}, {name_of}"
            for one, other in zip(rows[top + 1 :], in_feet[top + 1 :], strict=True):
                assert isinstance(one[j], int | float) == isinstance(other[j], int | float)
                if isinstance(one[j], int | float):
                    assert other[j] * factor == pytest.approx(one[j], abs=0.0085)
                    compared += 1
    assert compared > 100


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_files_in_feet_have_no_length_in_metres(convention):
    metric, table = tables(convention)
    for kind in ("csv", "raw_csv", "las"):
        text = made(table, kind).decode()
        head = [line for line in text.splitlines() if line.startswith(("# ", "H")) and "mwd " not in line[:7]]
        assert not [line for line in head if re.search(r"\d m\b(?!/)", line)], kind
        back, again = list_of(made(metric, kind), kind), list_of(text.encode(), kind)
        assert again.md == pytest.approx(back.md, abs=0.011)
        assert again.inclination == pytest.approx(back.inclination, abs=2e-4)
        assert again.positions == pytest.approx(back.positions, abs=0.011)
    las = lasio.read(io.StringIO(made(table, "las").decode()))
    assert {one.unit for one in las.curves} <= {"FT", "DEG", "DEG/100FT", ""}
    assert {las.well[name].unit for name in ("STRT", "STOP", "STEP")} == {"FT"}
    assert not [name for name in rows_of(made(table, "csv"))[0] if name.endswith(("_m", "_30m"))]


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_files_that_are_in_metres_for_every_well_do_not_change_with_its_units(convention):
    metric, field = tables(convention)
    for write in (path_csv, FORMATS["deviation"].make):
        assert write(metric) == write(field)
