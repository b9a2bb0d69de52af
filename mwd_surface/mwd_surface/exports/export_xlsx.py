# SPDX-License-Identifier: Apache-2.0
"""The survey report as a workbook: its head on the first sheet, then a sheet for each table, numbers as numbers."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable
from typing import Any

from mwd_surface.exports.report_content import content
from mwd_surface.exports.report_edge import for_people
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.language.language import language

_MOST = 31  # characters of a sheet's name
_NUMBER = re.compile(r"-?\d+(?:[.,]\d+)?")
_FORBIDDEN = re.compile(r"[\[\]:*?/\\]")


def xlsx(table: SurveyTable) -> bytes:
    """Return the report of a table as an Excel workbook, in the language and units of the well."""
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
    for line in (*found.notes, "", found.certificate, *(f"{who}, {said.say('date')}" for who in found.signatures)):
        _append(head, (line,))
    head["A1"].font = Font(bold=True)
    head.column_dimensions["A"].width = 34
    for sheet in found.sheets:
        page = book.create_sheet(_name(sheet.heading, book.sheetnames))
        _append(page, (sheet.heading,))
        _append(
            page, [f"{title}, {unit}" if unit else title for title, unit in zip(sheet.titles, sheet.units, strict=True)]
        )
        for cell in page[2]:
            cell.font = Font(bold=True)
        for row in sheet.rows:
            _append(page, [cell if k in sheet.words else _value(cell) for k, cell in enumerate(row)])
        if sheet.legend:
            _append(page, (sheet.legend,))
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


def _append(page: Any, row: Iterable[str | float]) -> None:
    """Append a row; a text that looks like a formula stays a text."""
    page.append([str(cell) if isinstance(cell, str) else cell for cell in row])
    for cell in page[page.max_row]:
        if isinstance(cell.value, str):
            cell.data_type = "s"


def _value(text: str) -> str | float:
    """Return a printed number, with the decimal mark of any language, as a number; another text as it is."""
    return float(text.replace(",", ".")) if _NUMBER.fullmatch(text) else text


def _name(heading: str, taken: list[str]) -> str:
    """Return a name for a sheet: without forbidden characters, short, and not taken."""
    plain = _FORBIDDEN.sub(" ", heading)[:_MOST].strip()
    name, k = plain, 2
    while name.lower() in {one.lower() for one in taken}:
        name, k = f"{plain[: _MOST - 4]} {k}", k + 1
    return name
