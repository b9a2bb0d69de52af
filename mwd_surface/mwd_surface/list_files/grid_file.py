# SPDX-License-Identifier: Apache-2.0
"""
Files that are sheets of cells: .xlsx, Excel 2003 XML (SpreadsheetML), and HTML tables, often saved as .xls.

Each reader returns the rows of every sheet with their place in the file; empty rows are left out.
"""

from __future__ import annotations

import dataclasses
import datetime as dt
import io
import re
import zipfile
import zlib
from collections.abc import Iterator
from typing import Any

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import BudgetError
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.number_cells import Cell

_SPREADSHEETML = "urn:schemas-microsoft-com:office:spreadsheet"
_MOST_SPAN = 100  # largest number of columns that one cell of an HTML table may span
# Largest number of elements of an .xlsx file that are not rows, cells or their texts, and of sheets. openpyxl takes up
# to 0.1 ms for each of these elements, whatever its name, and several ms for each sheet.
_MOST_OTHER, _MOST_SHEETS = 100_000, 200
_OF_CELLS = re.compile(rb"<(?:\w+:)?(?:row|c|v|f|is|t|si|r|rPr)[\s/>]")
_SHEET = re.compile(rb"<(?:\w+:)?sheet[\s/>]")


@dataclasses.dataclass(frozen=True)
class Row:
    """One row: its place in the file, for messages, and its cells."""

    at: str
    cells: tuple[Cell, ...]


Sheets = list[tuple[str, list[Row]]]


def is_spreadsheet(data: bytes) -> bool:
    """Return whether the bytes begin like an .xlsx file, which is a zip archive."""
    return data.startswith(b"PK\x03\x04")


def is_html(text: str) -> bool:
    """Return whether a text begins like an HTML document or an HTML table."""
    return bool(
        re.match(
            r"\s*(?:<\?xml[^>]*>\s*)?(?:<!--.*?-->\s*)*<(?:!doctype\s+html|html|head|body|meta|table)\b",
            text[:5000],
            re.IGNORECASE | re.DOTALL,
        )
    )


def is_spreadsheet_xml(text: str) -> bool:
    """Return whether a text is an Excel 2003 XML workbook."""
    return _SPREADSHEETML in text[:5000] and bool(re.search(r"<(?:\w+:)?Workbook\b", text[:5000]))


def archive_sheets(data: bytes, name: str) -> Sheets:
    """
    Return name and rows of each sheet of an .xlsx file; numbers stay numbers.

    Raises
    ------
    ListFileError
        The archive is not an .xlsx file, cannot be read, unpacks to more bytes than the budget, or has too many cells,
        columns, sheets or other elements.
    """
    import openpyxl

    _check_archive(data, name)
    sheets: Sheets = []
    cells = 0
    try:
        book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
        for sheet in book.worksheets:
            rows: list[Row] = []
            sheets.append((sheet.title, rows))
            # The size that a sheet states may be wrong. Without it, each row ends at its last cell.
            sheet.reset_dimensions()
            # Count the cells that openpyxl creates: a row of a few bytes may state any row number and any last column,
            # and openpyxl fills the gap with empty cells.
            for k, row in enumerate(sheet.iter_rows(values_only=True), start=1):
                cells += 1 + len(row)
                budgets.SPREADSHEET.check("records", cells)
                width = max((j for j, cell in enumerate(row, start=1) if _said(cell)), default=0)
                budgets.SPREADSHEET.check("columns", width)
                if width:
                    rows.append(Row(f"{name}, sheet {sheet.title}, row {k}", tuple(map(_cell, row[:width]))))
    except BudgetError as error:
        raise ListFileError(f"{name} {error}") from error
    except Exception as error:  # openpyxl passes on any exception of its parsers
        raise ListFileError(f"{name}: cannot be read as .xlsx: {error}") from error
    return sheets


def _check_archive(data: bytes, name: str) -> None:
    """Raise ListFileError for an archive that is not an .xlsx workbook, or that needs too much memory or time."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = set(archive.namelist())
            too_much = _too_much(archive)
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError, zlib.error) as error:
        raise ListFileError(f"{name}: cannot be read as .xlsx: {error}") from error
    if "xl/workbook.bin" in names:
        raise ListFileError(f"{name} is a binary Excel workbook (.xlsb), which is not read; save it as .xlsx or CSV")
    if "content.xml" in names:
        raise ListFileError(f"{name} is an OpenDocument file (.ods), which is not read; save it as .xlsx or CSV")
    if not any(item.startswith("xl/") for item in names):
        raise ListFileError(f"{name} is an archive that is not an .xlsx spreadsheet; save the list as .xlsx or CSV")
    if too_much:
        raise ListFileError(f"{name}: {too_much}")


def _too_much(archive: zipfile.ZipFile) -> str:
    """
    Return the budget that an archive exceeds, in words; empty if it exceeds none.

    Every file of the archive is counted, because any of them may be used as a sheet.
    """
    items = archive.infolist()
    most = budgets.SPREADSHEET.unpacked or 0
    if sum(item.file_size for item in items) > most:
        return f"unpacks to more than {most / budgets.MB:g} MB"
    other = sheets = 0
    for item in items:
        part = archive.read(item)
        other += part.count(b"<") - part.count(b"</") - sum(1 for _ in _OF_CELLS.finditer(part))
        sheets += sum(1 for _ in _SHEET.finditer(part))
        if other > _MOST_OTHER:
            return f"has more than {_MOST_OTHER} styles, names and other elements; save the list alone, as CSV"
        if sheets > _MOST_SHEETS:
            return f"has more than {_MOST_SHEETS} sheets; save the list alone"
    return ""


def html_sheets(text: str, name: str) -> Sheets:
    """
    Return name and rows of each table of an HTML document, except tables that contain other tables.

    Raises
    ------
    ListFileError
        The document cannot be read, has no table, or has more cells than the budget.
    """
    from lxml import etree, html

    try:
        root = html.document_fromstring(re.sub(r"^\s*<\?xml[^>]*>", "", text))
    except (etree.ParserError, etree.XMLSyntaxError, ValueError) as error:
        raise ListFileError(f"{name}: cannot be read as HTML: {error}") from error
    sheets: Sheets = []
    budget = _Cells(name)
    for k, table in enumerate(
        (one for one in root.iter("table") if not any(True for _ in one.iterdescendants("table"))), start=1
    ):
        rows = []
        for row in table.iter("tr"):
            cells: list[Cell] = []
            for cell in row.iterchildren("td", "th"):
                span = cell.get("colspan", "1")
                budget.add()
                cells += [" ".join("".join(cell.itertext()).split())]
                cells += [""] * (min(int(span), _MOST_SPAN) - 1 if span.isdecimal() else 0)
            rows += _row(f"{name}, table {k}, line {row.sourceline}", cells)
        sheets.append((f"table {k}", rows))
    if not sheets:
        raise ListFileError(f"{name} is an HTML document without a table; save the list as .xlsx or CSV")
    return sheets


def xml_root(text: str, name: str) -> Any:
    """Return the root element of an XML document; raise ListFileError if it is not well-formed."""
    from lxml import etree

    # The file comes from outside: do not resolve entities and do not use the network.
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        # The text is already decoded, so the encoding in its declaration no longer holds.
        return etree.fromstring(re.sub(r"^\s*<\?xml[^>]*\?>", "", text.lstrip("\ufeff")).encode(), parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise ListFileError(f"{name}: not well-formed XML: {error}") from error


def xml_sheets(text: str, name: str) -> Sheets:
    """
    Return name and rows of each sheet of an Excel 2003 XML workbook; numbers stay numbers.

    Raises
    ------
    ListFileError
        The document is not well-formed XML, or has more cells than the budget.
    """
    root = xml_root(text, name)
    ss = f"{{{_SPREADSHEETML}}}"
    sheets: Sheets = []
    budget = _Cells(name)
    for sheet in root.iter(f"{ss}Worksheet"):
        rows = []
        for row in sheet.iter(f"{ss}Row"):
            cells: list[Cell] = []
            for place, cell in _placed(row, ss):
                budget.add(max(1, place - len(cells)), place)
                cells += [""] * (place - len(cells))
                cells.append(_typed(cell.find(f"{ss}Data"), ss))
            rows += _row(f"{name}, sheet {sheet.get(f'{ss}Name', '')}, line {row.sourceline}", cells)
        sheets.append((str(sheet.get(f"{ss}Name", "")), rows))
    return sheets


def _placed(row: Any, ss: str) -> Iterator[tuple[int, Any]]:
    """Yield the column, from 0, and the cell, for each cell of a row; a cell may state its column and span several."""
    place = 0
    for cell in row.iterchildren(f"{ss}Cell"):
        said = cell.get(f"{ss}Index", "")
        place = int(said) - 1 if said.isdecimal() and int(said) > place else place
        yield place, cell
        across = cell.get(f"{ss}MergeAcross", "")
        place += 1 + (int(across) if across.isdecimal() else 0)


def _typed(data: Any, ss: str) -> Cell:
    if data is None:
        return ""
    text = "".join(data.itertext()).strip()
    if data.get(f"{ss}Type") == "Number":
        try:
            return float(text)
        except ValueError:
            return text
    return text


class _Cells:
    """Counter that checks the number of created cells against the budget of spreadsheets."""

    def __init__(self, name: str) -> None:
        self._name, self._count = name, 0

    def add(self, count: int = 1, column: int = 0) -> None:
        """Count cells; raise ListFileError when there are too many, or when `column` is above the limit of columns."""
        self._count += count
        try:
            budgets.SPREADSHEET.check("records", self._count)
            budgets.SPREADSHEET.check("columns", column)
        except BudgetError as error:
            raise ListFileError(f"{self._name} {error}") from error


def _row(at: str, cells: list[Cell]) -> list[Row]:
    """Return a list with one row, without the empty cells at its end; an empty list if all cells are empty."""
    width = max((j for j, cell in enumerate(cells, start=1) if _said(cell)), default=0)
    return [Row(at, tuple(cells[:width]))] if width else []


def _said(cell: object) -> bool:
    return cell is not None and str(cell).strip() != ""


def _cell(cell: object) -> Cell:
    if cell is None:
        return ""
    if isinstance(cell, (int, float)) and not isinstance(cell, bool):
        return float(cell)
    if isinstance(cell, dt.datetime):
        return cell.isoformat()
    return str(cell).strip()
