# SPDX-License-Identifier: Apache-2.0
"""
Survey report as a workbook: its head on the first sheet, then a sheet for each table, with numbers as numeric cells.

The sentences of a section stand above its first table. An additional last column has the reason why a row is
highlighted. Drawings, and the sentences of a section that has only drawings, are only in the HTML and PDF reports.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable
from typing import Any

from mwd_surface.exports.report_content import content
from mwd_surface.exports.report_edge import for_people
from mwd_surface.exports.report_section import TINTS, Section, Sheet
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.language.language import language

_SHADED = "FFF3E0"  # colour of a highlighted row
_MOST = 31  # largest number of characters of a sheet's name in Excel
_NUMBER = re.compile(r"-?\d+(?:[.,]\d+)?")
_FORBIDDEN = re.compile(r"[\[\]:*?/\\]")


def xlsx(table: SurveyTable) -> bytes:
    """
    Return the report of a table as an Excel workbook, in the language and units of the well.

    Raises ValueError if the language of the well is unknown.
    """
    from openpyxl import Workbook
    from openpyxl.styles import Font

    well = table.surveys.well
    said = language(well.language)
    found = for_people(content(table), said, well.units)
    book = Workbook()
    head = book.worksheets[0]
    head.title = _name(said.say("Head"), [])
    _append(head, (found.title,))
    for pair in found.header:
        _append(head, pair)
    loose = [line for section in found.sections if not (section.sheets or section.drawings) for line in _texts(section)]
    for line in (
        *found.notes,
        *loose,
        "",
        found.certificate,
        *(f"{who}, {said.say('date')}" for who in found.signatures),
    ):
        _append(head, (line,))
    head["A1"].font = Font(bold=True)
    head.column_dimensions["A"].width = 34
    for section in found.sections:
        for k, sheet in enumerate(section.sheets):
            page = book.create_sheet(_name(sheet.heading, book.sheetnames))
            _fill(page, sheet, () if k else section.text, said.say("Remark"))
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


def _texts(section: Section) -> tuple[str, ...]:
    """Return heading and sentences of a section; empty if the section has no sentences."""
    return (section.heading, *section.text) if section.text else ()


def _fill(page: Any, sheet: Sheet, sentences: Iterable[str], remark: str) -> None:
    """
    Write a table with its tints, and the sentences above the table.

    If a row is marked, a last column has the reasons; remark: title of this column.
    """
    from openpyxl.styles import Font, PatternFill

    for line in (sheet.heading, *sentences):
        _append(page, (line,))
    titles = [f"{title}, {unit}" if unit else title for title, unit in zip(sheet.titles, sheet.units, strict=True)]
    marked = any(sheet.marks)
    _append(page, [*titles, remark] if marked else titles)
    above = page.max_row
    for cell in page[above]:
        cell.font = Font(bold=True)
    for row, mark in zip(sheet.rows, sheet.marks, strict=True):
        cells = [cell if k in sheet.words else _value(cell) for k, cell in enumerate(row)]
        _append(page, [*cells, mark] if marked else cells)
        if mark:
            for cell in page[page.max_row]:
                cell.fill = PatternFill("solid", fgColor=_SHADED)
    for (k, column), tint in sheet.tints.items():
        page.cell(above + 1 + k, column + 1).fill = PatternFill("solid", fgColor=TINTS[tint].removeprefix("#"))
    if sheet.legend:
        _append(page, (sheet.legend,))


def _append(page: Any, row: Iterable[str | float]) -> None:
    """Append a row; a text that looks like a formula is stored as a text."""
    page.append([str(cell) if isinstance(cell, str) else cell for cell in row])
    for cell in page[page.max_row]:
        if isinstance(cell.value, str):
            cell.data_type = "s"


def _value(text: str) -> str | float:
    """Return a printed number, with a decimal point or comma, as a number; return any other text unchanged."""
    return float(text.replace(",", ".")) if _NUMBER.fullmatch(text) else text


def _name(heading: str, taken: list[str]) -> str:
    """Return a name for a sheet: without forbidden characters, at most 31 characters, and not in `taken`."""
    plain = _FORBIDDEN.sub(" ", heading)[:_MOST].strip()
    name, k = plain, 2
    while name.lower() in {one.lower() for one in taken}:
        name, k = f"{plain[: _MOST - 4]} {k}", k + 1
    return name
