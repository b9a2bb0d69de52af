# SPDX-License-Identifier: Apache-2.0
"""The workbook says everything that the printed report says beside its tables: sentences, marks and tints."""

import io

import example_surveys as example
import openpyxl
import pytest

from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.exports.export import FORMATS
from mwd_surface.exports.report_content import content
from mwd_surface.exports.report_edge import for_people
from mwd_surface.exports.report_logs import health_section
from mwd_surface.exports.report_section import TINTS, Section, sheet_of
from mwd_surface.language.language import language
from mwd_surface.logs.tool_health import HealthLedger
from mwd_surface.signals.table import Display

S = 10**9


def health():
    """Health of a tool whose file states neither battery nor limits."""
    ledger = HealthLedger(None)
    for at in range(60, 3600, 60):
        for name, unit, value in (("temperature", "degC", 130.0), ("battery_voltage", "V", 27.5)):
            ledger.add(LogSample(example.START + at * S, name, unit, 60.0, 60.0, value, 1.0, source=name))
    return health_section(ledger.health(), Display())


@pytest.mark.parametrize("spoken", ["en", "zh_CN"])
@pytest.mark.parametrize("units", ["metric", "field"])
def test_sentences_marks_and_tints_of_the_report_are_in_the_workbook(spoken, units):
    loose = Section("Nothing to tabulate", ("It is assumed that nothing happened.",))
    twice = Section(
        "Two tables", ("Both are assumed.",), tuple(sheet_of(name, [("A", "m")], [("1.0",)]) for name in "ab")
    )
    sections = (health(), loose, twice)
    table = example.table(well={"language": spoken, "units": units}, stretches=example.stretches(), sections=sections)
    found = for_people(content(table), language(spoken), units)
    book = openpyxl.load_workbook(io.BytesIO(FORMATS["xlsx"].make(table)))
    assert any("assum" in one or "假定" in one for one in found.sections[-3].text)
    lines = {page.title: [[cell.value for cell in row] for row in page.iter_rows()] for page in book.worksheets}
    first = {row[0] for row in lines[book.worksheets[0].title]}
    pages = iter(book.worksheets[1:])
    for section in found.sections:
        if not section.sheets and not section.drawings:
            assert {section.heading, *section.text} <= first
        for k, sheet in enumerate(section.sheets):
            page = next(pages)
            rows = lines[page.title]
            above = 2 + (0 if k else len(section.text))
            if not k:
                assert [row[0] for row in rows[1 : above - 1]] == list(section.text)
            for i, mark in enumerate(sheet.marks):
                assert (rows[above + i][len(sheet.titles) :] or [None])[0] == (mark or None)
            for (i, j), tint in sheet.tints.items():
                assert page.cell(above + 1 + i, j + 1).fill.fgColor.rgb[2:] == TINTS[tint].removeprefix("#")
    assert next(pages, None) is None
    assert any(any(sheet.marks) for sheet in found.sheets)
    assert any(sheet.tints for sheet in found.sheets)
