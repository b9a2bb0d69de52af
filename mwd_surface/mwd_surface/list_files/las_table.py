# SPDX-License-Identifier: Apache-2.0
"""The table of a LAS file: its curves (LAS 1.2, 2.0), or the section ~Inclinometry of LAS 3."""

from __future__ import annotations

import csv
import io
import logging
import re
from collections.abc import Iterator

import numpy as np

from mwd_sensors.core import budgets
from mwd_surface.list_files.grid_file import Row
from mwd_surface.list_files.list_columns import column_of, north_of
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.number_cells import Cell
from mwd_surface.list_files.table import Table

_LINE = re.compile(r"^\s*(?P<name>[^.:\s]+)\s*\.(?P<unit>\S*)\s*(?P<value>.*?)\s*:\s*(?P<words>.*)$")
# Curves in exports of this program whose numbers are codes for words, and the name of the text column they become.
_CODED = {"KIND": "station", "ASMD": "coordinates"}
_DELIMITERS = {"COMMA": ",", "TAB": "\t"}


def is_las(text: str) -> bool:
    """Return whether a text begins like a LAS file: with a section, or with comments before a section."""
    for line in text.splitlines()[:50]:
        if line.strip() and not line.lstrip().startswith("#"):
            return bool(re.match(r"\s*~\s*[VvWwCcPpAaOo]", line))
    return False


def las_table(text: str, name: str) -> Table:
    """
    Return the table of a LAS file.

    Raises
    ------
    ListFileError
        The text cannot be read as LAS.
    """
    return _inclinometry(text, name) or _curves(text, name)


def _curves(text: str, name: str) -> Table:
    import lasio

    # The log of lasio would show lines of the file on the terminal and in the logs of the nodes.
    log = logging.getLogger("lasio")
    log.addHandler(logging.NullHandler())
    log.propagate = False
    try:
        # lasio compares the name of each curve with all other names, so that the time grows with the square of their
        # number.
        budgets.LIST.check("columns", re.split(r"(?m)^\s*~A", text, maxsplit=1)[0].count("\n"))
        file = lasio.read(io.StringIO(text), ignore_header_errors=True)
        data = np.atleast_2d(file.data)
    except Exception as error:  # lasio passes on any exception of its parsing
        raise ListFileError(f"{name}: cannot be read as LAS: {error}") from error
    # In exports of this program, curves of verdicts and flags hold codes; their description spells out each code.
    texts = {
        k: (_CODED[curve.mnemonic], dict(re.findall(r"(\d+) ([\w-]+)", str(curve.descr))))
        for k, curve in enumerate(file.curves)
        if curve.mnemonic in _CODED and re.search(r"\b0 [a-z]", str(curve.descr))
    }
    columns = [k for k, curve in enumerate(file.curves) if not str(curve.descr).startswith("verdict ")]
    rows = []
    for number, row in enumerate(data, start=1):
        cells = (texts[k][1].get(_code(row[k]), "") if k in texts else _cell(row[k]) for k in columns)
        rows.append(Row(f"{name}, row {number}", tuple(cells)))
    names = tuple(texts[k][0] if k in texts else file.curves[k].mnemonic for k in columns)
    head = [f"{item.descr or item.mnemonic}: {item.value}" for item in (*file.well, *file.params)]
    head += [_described(curve.mnemonic, str(curve.descr)) for curve in file.curves]
    head += str(file.other or "").splitlines()
    units = tuple(str(file.curves[k].unit or "") for k in columns)
    return Table(name, name, names, units, tuple(rows), tuple(head))


def _code(value: object) -> str:
    """Return a code as text in the form used by the curve's description."""
    return f"{value:.0f}" if isinstance(value, (int, float, np.number)) else str(value)


def _described(name: str, words: str) -> str:
    """Return the description of an azimuth curve if the description names a north; otherwise ""."""
    return words if column_of(0, name).quantity == "azimuth" and north_of(words) else ""


def _cell(value: object) -> Cell:
    return float(value) if isinstance(value, (int, float, np.number)) else str(value).strip()


def _inclinometry(text: str, name: str) -> Table | None:
    """Return the table of the section ~Inclinometry of LAS 3; None if the file has no such section."""
    sections = list(_sections(text))
    definition = next((lines for title, lines in sections if re.match(r"inclinometry_?def", title)), None)
    titled = re.compile(r"inclinometry(_data)?\s*(\[1\])?\s*(\||$)")
    data = next((lines for title, lines in sections if titled.match(title)), None)
    if definition is None or data is None:
        return None
    found = [match for _, line in definition if (match := _LINE.match(line))]
    head, separator = [_described(match["name"], match["words"]) for match in found], ","
    for title, lines in sections:
        if not re.match(r"v|w|p|inclinometry_?par", title):
            continue
        for _, line in lines:
            match = _LINE.match(line)
            if match:
                head.append(f"{re.sub(r'{.*}', '', match['words']).strip()}: {match['value']}")
                if match["name"].upper() == "DLM":
                    separator = _DELIMITERS.get(match["value"].strip().upper(), " ")
    rows = []
    for number, line in data:
        cells = line.split() if separator == " " else next(csv.reader([line], delimiter=separator))
        rows.append(Row(f"{name}, line {number}", tuple(cell.strip() for cell in cells)))
    names, units = tuple(match["name"] for match in found), tuple(match["unit"] for match in found)
    return Table(name, name, names, units, tuple(rows), tuple(head))


def _sections(text: str) -> Iterator[tuple[str, list[tuple[int, str]]]]:
    """Yield the title in lower case and the numbered lines of each section, without comments."""
    title = ""
    lines: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.lstrip().startswith("~"):
            yield title, lines
            title, lines = line.strip()[1:].strip().lower(), []
        elif line.strip() and not line.lstrip().startswith("#"):
            lines.append((number, line))
    yield title, lines
