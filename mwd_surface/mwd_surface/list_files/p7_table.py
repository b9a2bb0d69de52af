# SPDX-License-Identifier: Apache-2.0
"""
The table of a file in the IOGP's exchange format P7/17 for wellbore positions.

Records are lines of comma-separated fields: HC and H7 are the head, O7 positions of objects, P7 the stations. Source:
IOGP reports 483-7 and 483-7u, "P7/17 wellbore positioning data exchange format" and its user guide.
"""

from __future__ import annotations

import csv

from mwd_surface.list_files.grid_file import Row
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.list_files.table import Table

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
        raise ListFileError(f"{name}: a P7/17 file without P7 records; it has no stations")
    if len(units) > 1 or len(norths) > 1:
        words = " and ".join(sorted(units if len(units) > 1 else norths))
        raise ListFileError(f"{name}: its surveys are in {words}; write one file for each")
    unit, chart = units.pop() if units else "", map_units.pop() if len(map_units) == 1 else ""
    north = norths.pop() if norths else ""
    remarks = []
    if left_out:
        said = f"{name}: {left_out} P7 records that are projections or of other tables are left out"
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
