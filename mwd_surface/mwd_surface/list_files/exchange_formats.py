# SPDX-License-Identifier: Apache-2.0
"""
Tables of stations in exchange formats: LAS, P7/17 and WITSML.

Of a LAS file, the curves (LAS 1.2, 2.0) or the section ~Inclinometry of LAS 3 are read. A file in the IOGP's format
P7/17 for wellbore positions has records, which are lines of comma-separated fields: HC and H7 are the head, O7
positions of objects, P7 the stations. Source: IOGP reports 483-7 and 483-7u, "P7/17 wellbore positioning data exchange
format" and its user guide. Of a WITSML document (1.3.1.1, 1.4.1.1, 2.0 or 2.1), the first trajectory is read, whose
elements are found by their names.
"""

from __future__ import annotations

import csv
import io
import logging
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from mwd_sensors.core import budgets
from mwd_surface.list_files.grid_file import Row, xml_root
from mwd_surface.list_files.list_columns import (
    ANGLE_UNITS,
    ANGLES,
    ENERGISTICS_ANGLES,
    ENERGISTICS_UNITS,
    LENGTH_UNITS,
    column_of,
    north_of,
    unit_word,
)
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.number_cells import Cell, is_null
from mwd_surface.list_files.remark import Remark, RemarkKind
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


# Indices of fields in a P7 record: number of the survey, type, status, and the first of the values in `_NAMES`.
_SURVEY, _TYPE, _STATUS, _FIRST = 3, 7, 8, 10
_NAMES = ("MD", "INC", "AZI", "NS", "EW", "TVD", "NORTHING", "EASTING")
_PROJECTED = "6"  # status of a projected station
_NORTHS = {"AZ_GRID": "grid", "AZ_TRUE": "true", "AZ_MAGN": "magnetic", "AZ_MAG": "magnetic"}
_UNIT_FIELD = 16  # index of the field with the unit of measured depths, in the record "Survey Definition"


def is_p7(text: str) -> bool:
    """Return whether a text is P7/17, by its first record or because it has P7 or H7 records."""
    lines = text.splitlines()[:400]
    first = lines[0].upper().split(",") if lines else []
    named = len(first) > 2 and first[0].strip() in ("IOGP", "OGP") and first[2].strip() == "7"
    return named or any(line.startswith(("P7,0,", "H7,1,")) for line in lines)


def p7_table(text: str, name: str) -> Table:
    """
    Return the stations of the first table of a P7/17 file, in the order of the file.

    Projected stations, and stations with status 0 except the first station, are left out.

    Raises
    ------
    ListFileError
        The file has no P7 record, or its surveys differ in unit or north.
    """
    units, norths, map_units = set(), set(), set()
    rows: list[Row] = []
    left_out = 0
    table = ""
    wellhead: tuple[str, str] | None = None
    eastings_first = False
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.startswith(("P7,", "H7,", "HC,", "O7,")):
            continue
        fields = [field.strip() for field in next(csv.reader([line], skipinitialspace=True))]
        if fields[:4] == ["H7", "1", "5", "0"] and len(fields) > _UNIT_FIELD:
            units.add(fields[_UNIT_FIELD])
        elif fields[:4] == ["H7", "1", "5", "1"]:
            norths |= {_NORTHS.get(field.upper(), field) for field in fields if field.upper().startswith("AZ_")}
        elif (
            fields[:4] == ["HC", "1", "6", "1"] and len(fields) > 11 and fields[8].lower().startswith(("north", "east"))
        ):
            map_units.add(fields[-1])
            eastings_first |= fields[6] == "1" and fields[8].lower().startswith("east")
        elif fields[0] == "O7" and len(fields) > 6 and "WRP" in fields[3:5]:
            wellhead = fields[5], fields[6]
        elif fields[0] == "P7" and len(fields) > _FIRST + 2:
            table = table or fields[2]
            if fields[2] != table or fields[_STATUS] == _PROJECTED:
                left_out += 1
            elif fields[_STATUS] != "0" or not rows:
                cells = tuple(fields[_FIRST : _FIRST + len(_NAMES)])
                rows.append(Row(f"{name}, line {number}", cells))
    if not rows:
        raise ListFileError(f"{name}: the P7/17 file has no P7 records, so it has no stations")
    if len(units) > 1 or len(norths) > 1:
        words = " and ".join(sorted(units if len(units) > 1 else norths))
        raise ListFileError(f"{name}: its surveys are in {words}; write one file for each")
    unit, chart = units.pop() if units else "", map_units.pop() if len(map_units) == 1 else ""
    north = norths.pop() if norths else ""
    remarks = []
    if left_out:
        said = f"{name}: {left_out} P7 records are left out: they are projections or belong to other tables"
        remarks.append(Remark(RemarkKind.ROWS_LEFT_OUT, said, {"rows": float(left_out)}))
    columns = (unit, "deg", "deg", unit, unit, unit, chart or unit, chart or unit)
    head = [f"azimuth reference: {north}"] if north else []
    axes = ("easting", "northing") if eastings_first else ("northing", "easting")
    if wellhead is not None:
        head += [f"wellhead {axis}: {number} ({chart or unit})" for axis, number in zip(axes, wellhead, strict=True)]
    names = (*_NAMES[:-2], *(("EASTING", "NORTHING") if _exchanged(rows) else _NAMES[-2:]))
    return Table(name, name, names, columns, tuple(rows), tuple(head), tuple(remarks))


def _exchanged(rows: list[Row]) -> bool:
    """
    Return whether the records give the easting before the northing.

    The result is true if the differences between first and last record fit the offsets better after an exchange of the
    two coordinates, and false if a coordinate or offset is missing.
    """
    try:
        first, last = ([float(rows[k].cells[j]) for j in (3, 4, 6, 7)] for k in (0, -1))
    except ValueError:
        return False
    n, e, one, two = (b - a for a, b in zip(first, last, strict=True))
    return abs(one - e) + abs(two - n) < abs(one - n) + abs(two - e)


# Quantity -> element name in lower case; the name begins with a small letter in versions 1.x, with a capital in 2.x.
_TAGS = {"md": "md", "inclination": "incl", "azimuth": "azi", "tvd": "tvd", "north": "dispns", "east": "dispew"}
_PROJECTIONS = ("hold to md", "dls and toolface to md", "extrapolated")


def witsml_table(text: str, name: str) -> Table:
    """
    Return the stations of the first trajectory in a document, in m and rad.

    Raises
    ------
    ListFileError
        The document is not XML, has no trajectory, a station without md or incl, or an unknown unit.
    """
    root = xml_root(text, name)
    trajectories = [one for one in root.iter() if _tag(one) == "trajectory" and _children(one, "trajectorystation")]
    if not trajectories:
        empty = any(_tag(one) == "trajectory" for one in root.iter())
        nothing = "the document has no trajectory of WITSML 1.3, 1.4, 2.0 or 2.1"
        what = "no trajectory of the document has a station" if empty else nothing
        raise ListFileError(f"{name}, line {root.sourceline}: {what}")
    trajectory = trajectories[0]
    remarks = []
    if len(trajectories) > 1:
        said = f"{name}: the first of {len(trajectories)} trajectories is read"
        remarks.append(Remark(RemarkKind.COLUMN_CHOSEN, said, {"trajectories": float(len(trajectories))}))
    reference = _text(trajectory, "aziref")
    rows, projected = [], 0
    for station in _children(trajectory, "trajectorystation"):
        kind = _text(station, "typetrajstation")
        # A projection to the bit is not a station.
        if kind.lower() in _PROJECTIONS:
            projected += 1
            continue
        at = f"{name}, line {int(station.sourceline or 0)}"
        cells = [_measure(station, what, tag, at) for what, tag in _TAGS.items()]
        tool = _text(station, "typesurveytool") or kind
        row = "tie-on" if kind.lower() == "tie in point" else ""
        rows.append(Row(at, (*cells, tool, _text(station, "dtimstn"), row, _text(station, "statustrajstation"))))
    # The order of the elements of a document has no meaning.
    rows.sort(key=lambda row: float(row.cells[0] or 0.0))
    if projected:
        said = f"{name}: {projected} projections to the bit are left out"
        remarks.append(Remark(RemarkKind.ROWS_LEFT_OUT, said, {"rows": float(projected)}))
    names = (*_TAGS, "tool", "time", "station", "verdict")
    units = ("m", "rad", "rad", "m", "m", "m", "", "", "", "")
    title = _text(trajectory, "name") or _text(trajectory, "title") or name
    head = [f"azimuth reference: {reference}"] if reference else []
    for custom in _children(trajectory, "customdata"):
        # Exports of this program store the provenance of their list in this element.
        head += [str(one.text or "") for one in custom if _tag(one) == "provenance"]
    return Table(title, name, names, units, tuple(rows), tuple(head), tuple(remarks))


def _tag(element: Any) -> str:
    """Return the name of an element in lower case, without its namespace; empty for comments."""
    return str(element.tag).rpartition("}")[2].lower() if isinstance(element.tag, str) else ""


def _children(element: Any, tag: str) -> list[Any]:
    return [child for child in element if _tag(child) == tag]


def _text(element: Any, tag: str) -> str:
    """
    Return the text of the first element of this name inside an element; "" if there is none.

    In a trajectory only the elements before its first station are searched.
    """
    for child in element.iter():
        if child is not element and _tag(child) == tag:
            return " ".join("".join(child.itertext()).split())
        if child is not element and _tag(child) == "trajectorystation" and _tag(element) == "trajectory":
            break
    return ""


def _measure(station: Any, what: str, tag: str, at: str) -> Cell:
    """
    Return a measure of a station in m or rad; empty text if the station has none.

    Raises ListFileError if md or inclination is missing, or if a number or unit is not valid.
    """
    found = _children(station, tag)
    if not found:
        if what in ("md", "inclination"):
            raise ListFileError(f"{at}: the station has no {tag}")
        return ""
    # Version 2.1 wraps depths in an element that names their datum.
    element = next((one for one in found[0].iter() if (one.text or "").strip()), found[0])
    text = (element.text or "").strip()
    if is_null(text):
        if text.lower() in ("nan", "inf", "-inf") or not text:
            raise ListFileError(f"{at}: {tag}: expected a finite number, got {text!r}")
        return ""
    uom = element.get("uom") or found[0].get("uom") or ""
    factor = _factor(uom, angle=what in ANGLES)
    if factor is None:
        usual = ("dega", "rad", "gon") if what in ANGLES else ("m", "km", "ft", "ftUS", "in")
        raise ListFileError(
            f"{at}: {what} in {uom!r}, which is not a known unit; expected {', '.join(usual)} ...,"
            " as in the Energistics unit dictionary"
        )
    try:
        return float(text) * factor
    except ValueError:
        raise ListFileError(f"{at}: {tag}: expected a finite number, got {text!r}") from None


def _factor(uom: str, *, angle: bool) -> float | None:
    """Return the factor of a unit to m or rad; None if it is not a unit of the quantity."""
    if uom.strip() in ENERGISTICS_UNITS:
        return ENERGISTICS_UNITS[uom.strip()] if (uom.strip() in ENERGISTICS_ANGLES) == angle else None
    return (ANGLE_UNITS if angle else LENGTH_UNITS).get(unit_word(uom))
