# SPDX-License-Identifier: Apache-2.0
"""
Reading a list of stations from a file: a table (CSV or columns of text), LAS, or a WITSML 1.4.1.1 trajectory.

Survey lists, gyro surveys and planned paths are read by the same rules. A file that is not what it should be raises
`ListFileError` with the line at fault and what was expected there; a list is never half read.
"""

from __future__ import annotations

import csv
import dataclasses
import logging
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from mwd_sensors.core import budgets
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.budgets import BudgetError
from mwd_sensors.core.input_files import check_lines, read_file
from mwd_surface.list_files import list_columns
from mwd_surface.list_files.list_columns import FIGURES, NEEDED, NORTHS, TEXTS, Given, ListFileError

WITSML = "{http://www.witsml.org/schemas/1series}"
_TAGS = {"md": "md", "inclination": "incl", "azimuth": "azi", "tvd": "tvd", "north": "dispNs", "east": "dispEw"}
# Lines above the one that names the columns, as programs for people write them.
_PREAMBLE = 60
_POSITION = ("north", "east", "tvd")
_ARC = 60.0  # m; stations farther apart leave out others


@dataclasses.dataclass(frozen=True)
class StationList:
    """
    Stations as a file has them.

    Attributes
    ----------
    name, north : str
        For people; and what azimuths are from: "magnetic", "true", "grid", or "" where the file does not say.
    md, inclination, azimuth : ndarray, shape (n,)
        m, increasing; rad. An azimuth that is not given is nan.
    positions : ndarray, shape (n, 3)
        North, east, down as the file has them, m; nan where it has none. They are checked against the angles.
    sigma_inclination, sigma_azimuth : ndarray, shape (n,)
        rad; nan where not given.
    tool, time, verdict : tuple of str
        Of each station as written; empty where not given.
    figures : mapping of ndarray, shape (n,)
        Reference of each station by the names of `list_columns.FIGURES`: T, m/s^2, rad; nan where not given.
    remarks : tuple of str
        What people must know about how it was read.
    """

    name: str
    north: str
    md: Array
    inclination: Array
    azimuth: Array
    positions: Array
    sigma_inclination: Array
    sigma_azimuth: Array
    tool: tuple[str, ...]
    time: tuple[str, ...]
    verdict: tuple[str, ...]
    figures: Mapping[str, Array]
    remarks: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class _Row:
    """One station of the file in m and rad, its texts, and where it stands."""

    at: str
    numbers: Mapping[str, float]
    texts: Mapping[str, str]


def is_list(path: Path) -> bool:
    """Whether a file may be a list of stations, by its ending."""
    return path.is_file() and path.suffix.lower() in (".csv", ".txt", ".tsv", ".las", ".xml", ".dat", ".prn")


def read_list(path: str | Path, given: Given | None = None) -> StationList:
    """
    The stations of a file: WITSML where it starts like XML, LAS where it starts like LAS, and a table otherwise.

    Raises
    ------
    ListFileError
        The file is missing, unreadable, too large, or no list of stations; see the module.
    """
    path = Path(path)
    try:
        data = read_file(path, budgets.LIST)
    except OSError as error:
        raise ListFileError(f"{path}: {error.strerror}") from error
    start = data.lstrip(b"\xef\xbb\xbf \t\r\n")
    if start.startswith(b"<"):
        return list_from_witsml(data, path.name, given)
    if start.startswith(b"~") or path.suffix.lower() == ".las":
        return list_from_las(data, path.name, given)
    return list_from_table(data, path.name, given)


def list_from_table(data: bytes, name: str = "list", given: Given | None = None) -> StationList:
    """
    The stations of a table.

    One line names the columns, with the unit at the end of a name (md_m, md_ft, "MD [m]") or in a line of its own
    below. Needed: md, inclination, azimuth. Angles without unit are degrees. Lines starting with # are remarks, and
    so are lines above the names. Fields are parted by comma, semicolon, tab or spaces; a decimal comma is understood
    except where commas part fields. The azimuth's name may say its north (azi_grid_deg), or a column azimuth_reference.

    Raises
    ------
    ListFileError
        With the line at fault.
    """
    whole = [(k, line) for k, line in enumerate(_within_budget(_text(data), name).splitlines(), 1) if line.strip()]
    lines = [(k, line) for k, line in whole if not line.startswith("#")]
    if not lines:
        raise ListFileError(f"{name}: empty")
    head = next((k for k in range(min(_PREAMBLE, len(lines))) if not _header(lines[k][1], name, given).missing), 0)
    where, header = lines[head]
    at = f"{name}, line {where}"
    separator = _separator(header)
    names = _fields(header, separator, at)
    columns = list_columns.find(names, given)
    if columns.missing:
        raise ListFileError(
            f"{at}: no column for {', '.join(columns.missing)}; expected a header such as"
            f" md_m,inclination_deg,azimuth_deg, or the columns' names (mwd path --columns); got {', '.join(names)}"
        )
    body = [(f"{name}, line {k}", _fields(line, separator, f"{name}, line {k}")) for k, line in lines[head + 1 :]]
    if body and not any(_is_number(c) for c in body[0][1]):
        own = list_columns.find(names, given, [_plain_unit(c) for c in body[0][1]] + [""] * len(names))
        columns = dataclasses.replace(columns, units=own.units)
        body = body[1:]
    # The head block of our own exports names the north.
    head_block = next((line for _, line in whole if line.lower().startswith("# azimuth reference:")), "").lower()
    north = columns.north or next((north for north in NORTHS if north in head_block), "")
    return _list(_rows(columns, body, at, given), north, name, given)


def list_from_las(data: bytes, name: str = "list", given: Given | None = None) -> StationList:
    """
    The stations of a LAS file, by the names and units of its curves; rows without depth or inclination are left out.

    Raises
    ------
    ListFileError
        It cannot be read, or its curves are not those of a survey.
    """
    import io

    import lasio

    text = _within_budget(_text(data), name)
    header = re.split(r"(?m)^~A", text, maxsplit=1)[0]
    # Its log would quote lines of the file on the terminal and in the logs of the nodes.
    log = logging.getLogger("lasio")
    log.addHandler(logging.NullHandler())
    log.propagate = False
    try:
        budgets.LIST.check("columns", header.count("\n"))
        file = lasio.read(io.StringIO(text), ignore_header_errors=True)
    except Exception as error:  # lasio raises whatever its parsing meets
        raise ListFileError(f"{name}: cannot be read as LAS: {error}") from error
    names = [curve.mnemonic for curve in file.curves]
    columns = list_columns.find(names, given, [_plain_unit(curve.unit) for curve in file.curves])
    if columns.missing:
        raise ListFileError(f"{name}: no curve for {', '.join(columns.missing)}; it has {', '.join(names)}")
    kind = names.index("KIND") if "KIND" in names else None
    body, skipped = [], 0
    for k, row in enumerate(np.atleast_2d(file.data), start=1):
        if kind is not None and float(row[kind]) == 2.0:
            continue
        if any(not _is_number(str(row[columns.number[what]])) for what in ("md", "inclination")):
            skipped += 1
            continue
        cells = [str(cell) if _is_number(str(cell)) or isinstance(cell, str) else "" for cell in row]
        body.append((f"{name}, row {k}", cells))
    read = _list(_rows(columns, body, name, given), columns.north or _las_north(file), name, given)
    remark = (f"{name}: {skipped} rows without depth or inclination are left out",) if skipped else ()
    return dataclasses.replace(read, remarks=read.remarks + remark)


def list_from_witsml(data: bytes, name: str = "list", given: Given | None = None) -> StationList:
    """
    The stations of the first trajectory in a WITSML 1.4.1.1 document.

    Raises
    ------
    ListFileError
        With the line at fault: not XML, no trajectory, a station without md, incl or azi, or an unknown unit.
    """
    from lxml import etree

    # No entities, no network: the file comes from elsewhere.
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise ListFileError(f"{name}: not well-formed XML: {error}") from error
    trajectory = root.find(f"{WITSML}trajectory")
    if trajectory is None:
        raise ListFileError(f"{name}, line {root.sourceline}: no trajectory of WITSML 1.4.1.1 in it")
    reference = trajectory.findtext(f"{WITSML}aziRef", "").strip().removesuffix(" north")
    rows = []
    for station in trajectory.iterfind(f"{WITSML}trajectoryStation"):
        at = f"{name}, line {int(station.sourceline or 0)}"
        kind = station.findtext(f"{WITSML}typeTrajStation", "").strip()
        # A projection to the bit is no station.
        if kind in ("hold to MD", "DLS and toolface to MD"):
            continue
        numbers = {}
        for what, tag in _TAGS.items():
            element = station.find(WITSML + tag)
            if element is None:
                if what in NEEDED:
                    raise ListFileError(f"{at}: a station without {tag}")
                continue
            unit = list_columns.factor(what, element.get("uom", "").lower(), at, given)
            numbers[what] = _number(element.text or "", f"{at}: {tag}") * unit
        texts = {
            "tool": station.findtext(f"{WITSML}typeSurveyTool", "").strip() or kind,
            "time": station.findtext(f"{WITSML}dTimStn", "").strip(),
        }
        rows.append(_Row(at, numbers, texts))
    return _list(
        rows,
        reference if reference in NORTHS else "",
        trajectory.findtext(f"{WITSML}name", "").strip() or name,
        given,
    )


def _within_budget(text: str, name: str) -> str:
    try:
        check_lines(text, budgets.LIST)
    except BudgetError as error:
        raise ListFileError(f"{name}: {error}") from error
    return text


def _rows(
    columns: list_columns.Columns, body: Sequence[tuple[str, list[str]]], at: str, given: Given | None
) -> list[_Row]:
    """Rows of a table, in m and rad, of cells with their places in the file."""
    factors = {
        what: list_columns.factor(what, columns.units.get(what, ""), at, given)
        for what in columns.number
        if what not in TEXTS
    }
    rows = []
    for place, cells in body:
        numbers, texts = {}, {}
        for what, k in columns.number.items():
            if k >= len(cells):
                raise ListFileError(f"{place}: {len(cells)} fields, the header names {what} as number {k + 1}")
            if what in TEXTS:
                texts[what] = cells[k]
            elif cells[k] or what in ("md", "inclination"):
                numbers[what] = _number(cells[k], f"{place}: {what}") * factors[what]
        rows.append(_Row(place, numbers, texts))
    return rows


def _list(rows: list[_Row], north: str, name: str, given: Given | None) -> StationList:
    # Our own exports end with a projection to the bit, which is no station.
    rows = [row for row in rows if row.texts.get("station") != "projected"]
    if not rows:
        raise ListFileError(f"{name}: no station in it")
    rows, remarks = _increasing(rows)
    norths = {row.texts.get("azimuth_reference", "") for row in rows} & set(NORTHS)
    if len(norths) > 1:
        raise ListFileError(f"{name}: azimuths from {' and '.join(sorted(norths))} north in one list; export it as one")

    def column(what: str) -> Array:
        return np.array([row.numbers.get(what, math.nan) for row in rows])

    read = StationList(
        name=name,
        north=(given.north if given else "") or (norths.pop() if norths else "") or north,
        md=column("md"),
        inclination=column("inclination"),
        azimuth=column("azimuth") % math.tau,
        positions=np.column_stack([column(what) for what in _POSITION]),
        sigma_inclination=column("sigma_inclination"),
        sigma_azimuth=column("sigma_azimuth"),
        tool=tuple(row.texts.get("tool", "") for row in rows),
        time=tuple(row.texts.get("time", "") for row in rows),
        verdict=tuple(row.texts.get("verdict", "").lower() for row in rows),
        figures={what: column(what) for what in FIGURES},
        remarks=tuple(remarks),
    )
    _check_positions(read, [row.at for row in rows])
    return read


def _increasing(rows: list[_Row]) -> tuple[list[_Row], list[str]]:
    """The rows in range and in order of depth; a station written twice is taken once."""
    kept: list[_Row] = []
    remarks = []
    for row in rows:
        md, inclination, azimuth = (row.numbers.get(what, math.nan) for what in NEEDED)
        if not 0.0 <= inclination <= math.pi:
            shown = math.degrees(inclination)
            raise ListFileError(
                f"{row.at}: inclination {shown:g} deg is outside 0 to 180; is it in degrees, from the vertical?"
            )
        if not (math.isnan(azimuth) or -math.pi <= azimuth <= math.tau):
            raise ListFileError(f"{row.at}: azimuth {math.degrees(azimuth):g} deg is outside -180 to 360")
        above = kept[-1] if kept else None
        if above is not None and md <= above.numbers["md"]:
            if all(above.numbers.get(what) == row.numbers.get(what) for what in NEEDED):
                remarks.append(f"{row.at}: the same station again, taken once")
                continue
            raise ListFileError(f"{row.at}: measured depth {md:g} m does not increase after {above.numbers['md']:g} m")
        kept.append(row)
    return kept, remarks


def _check_positions(read: StationList, at: list[str]) -> None:
    """
    Compare the positions of a file with its angles.

    Lists by other methods differ by decimetres; another unit or north by much more.
    """
    azimuth = np.where(np.isnan(read.azimuth), 0.0, read.azimuth)
    try:
        computed = mc.path(read.md, read.inclination, azimuth)
    except ValueError as error:
        raise ListFileError(f"{read.name}: {error}") from error
    if np.isnan(read.azimuth).any():
        return
    difference = (read.positions - read.positions[0]) - (computed - computed[0])
    # Over a long gap the hole is no arc.
    gaps = np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(read.md) - _ARC, 0.0))])
    allowed = 1.0 + 0.005 * (read.md - read.md[0]) + 0.1 * gaps
    for k, axis in zip(*np.nonzero(np.abs(difference) > allowed[:, None]), strict=True):
        given, expected = read.positions[k, axis], read.positions[0, axis] + computed[k, axis] - computed[0, axis]
        raise ListFileError(
            f"{at[k]}: {_POSITION[axis]} {given:.2f} m does not fit the angles, which give {expected:.2f} m; check"
            " units and north"
        )


def _header(line: str, name: str, given: Given | None) -> list_columns.Columns:
    try:
        return list_columns.find(_fields(line, _separator(line), name), given)
    except ListFileError:
        return list_columns.Columns({}, {}, "")


def _separator(header: str) -> str:
    best = max(",;\t", key=header.count)
    if header.count(best):
        return best
    return "  " if "  " in header.strip() else " "


def _fields(line: str, separator: str, at: str) -> list[str]:
    if separator.isspace() and separator != "\t":
        # Names may have single spaces in them, numbers have none.
        parts = line.strip().split("  ") if separator == "  " else line.split()
        cells = [part.strip() for part in parts if part.strip()]
        return [c.replace(",", ".") for c in cells]
    try:
        cells = [c.strip() for c in next(csv.reader([line], delimiter=separator))]
    except csv.Error as error:
        raise ListFileError(f"{at}: {error}") from error
    return cells if separator == "," else [c.replace(",", ".") if _is_number(c.replace(",", ".")) else c for c in cells]


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _las_north(file: object) -> str:
    """The north that the parameters of our own LAS export name; empty where there are none."""
    for item in getattr(file, "params", ()):
        if str(item.descr).strip().lower() == "azimuth reference":
            return next((north for north in NORTHS if north in str(item.value).lower()), "")
    return ""


def _plain_unit(text: str) -> str:
    return "".join(c for c in text.lower().replace("°", "deg") if c.isascii() and c.isalpha())


def _number(text: str, at: str) -> float:
    if not _is_number(text):
        raise ListFileError(f"{at}: expected a finite number, got {text!r}")
    return float(text)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
