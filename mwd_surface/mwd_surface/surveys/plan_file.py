"""
Reading a planned well path from a file: a table (CSV) or a WITSML 1.4.1.1 trajectory.

A file that is not what it should be raises `PlanError` with the line at fault and what was expected there; a plan is
never half read, and a length whose unit nobody named is never guessed.
"""

from __future__ import annotations

import csv
import dataclasses
import math
import re
from pathlib import Path

from mwd_surface.surveys.plan import Plan, plan_of

LARGEST = 20_000_000
WITSML = "{http://www.witsml.org/schemas/1series}"

_UNITS = {
    "m": 1.0,
    "meter": 1.0,
    "metre": 1.0,
    "meters": 1.0,
    "metres": 1.0,
    "ft": 0.3048,
    "feet": 0.3048,
    "ftus": 0.3048006096,
}
_ANGLES = {"deg": math.pi / 180.0, "dega": math.pi / 180.0, "degrees": math.pi / 180.0, "rad": 1.0}
_NAMES = {
    "md": "md",
    "measured_depth": "md",
    "depth": "md",
    "dept": "md",
    "inc": "inclination",
    "incl": "inclination",
    "inclination": "inclination",
    "azi": "azimuth",
    "azim": "azimuth",
    "azimuth": "azimuth",
    "tvd": "tvd",
    "vertical_depth": "tvd",
    "north": "north",
    "ns": "north",
    "n_s": "north",
    "disp_ns": "north",
    "n": "north",
    "east": "east",
    "ew": "east",
    "e_w": "east",
    "disp_ew": "east",
    "e": "east",
}
_TAGS = {"md": "md", "inclination": "incl", "azimuth": "azi", "tvd": "tvd", "north": "dispNs", "east": "dispEw"}
_NORTHS = ("true", "grid", "magnetic")


class PlanError(ValueError):
    """A plan file that cannot be used; the message gives file, line and rule."""


@dataclasses.dataclass(frozen=True)
class _Row:
    """One station of the file, m and rad, and the line it stands on; None where the file has no such column."""

    line: int
    md: float
    inclination: float
    azimuth: float
    tvd: float | None = None
    north: float | None = None
    east: float | None = None


def read_plan(path: str | Path) -> Plan:
    """
    The plan of a file, WITSML where it starts like XML and a table otherwise.

    Raises
    ------
    PlanError
        The file is missing, unreadable, too large, or not a plan; see the module.
    """
    path = Path(path)
    try:
        if path.stat().st_size > LARGEST:
            raise PlanError(f"{path.name}: larger than {LARGEST // 1_000_000} MB: no plan of a well")
        data = path.read_bytes()
    except OSError as error:
        raise PlanError(f"{path}: {error.strerror}") from error
    if data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return plan_from_witsml(data, path.name)
    return plan_from_table(data, path.name)


def plan_from_table(data: bytes, name: str = "plan") -> Plan:
    """
    The plan of a table.

    One header line names the columns, with the unit at the end of the name (md_m, md_ft, "MD [m]") or in a line of
    its own below. Needed: md, inclination, azimuth; tvd, north, east are checked against them. Angles without unit
    are degrees. Lines starting with # are remarks. Fields are parted by comma, semicolon or tab; a decimal comma is
    understood except where commas part fields. The name of the azimuth may say its north (azi_grid_deg).

    Raises
    ------
    PlanError
        With the line at fault.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    lines = [
        (k, line) for k, line in enumerate(text.splitlines(), start=1) if line.strip() and not line.startswith("#")
    ]
    if not lines:
        raise PlanError(f"{name}: empty")
    where, header = lines[0]
    separator = max(",;\t", key=header.count)
    cells = _fields(header, separator, f"{name}, line {where}")
    columns, units, north = _columns(cells, f"{name}, line {where}")
    body = [(k, _fields(line, separator, f"{name}, line {k}")) for k, line in lines[1:]]
    if body and not any(_is_number(c) for c in body[0][1]):
        given = [re.sub(r"[^a-z]", "", c.lower()) for c in body[0][1]]
        units.update({what: given[k] for what, k in columns.items() if k < len(given) and given[k]})
        body = body[1:]
    factors = {what: _factor(what, units.get(what, ""), f"{name}, line {where}") for what in columns}
    rows = [_row(cells, columns, factors, f"{name}, line {k}", k) for k, cells in body]
    return _plan(rows, north, name)


def plan_from_witsml(data: bytes, name: str = "plan") -> Plan:
    """
    The plan of the first trajectory in a WITSML 1.4.1.1 document.

    Raises
    ------
    PlanError
        With the line at fault: not XML, no trajectory, a station without md, incl or azi, or an unknown unit.
    """
    from lxml import etree

    # No entities, no network: a plan file comes from elsewhere.
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise PlanError(f"{name}: not well-formed XML: {error}") from error
    trajectory = root.find(f"{WITSML}trajectory")
    if trajectory is None:
        raise PlanError(f"{name}, line {root.sourceline}: no trajectory of WITSML 1.4.1.1 in it")
    reference = trajectory.findtext(f"{WITSML}aziRef", "").strip().removesuffix(" north")
    rows = []
    for station in trajectory.iterfind(f"{WITSML}trajectoryStation"):
        line = int(station.sourceline or 0)
        at = f"{name}, line {line}"
        values = {}
        for what, tag in _TAGS.items():
            element = station.find(WITSML + tag)
            if element is None:
                if what in ("md", "inclination", "azimuth"):
                    raise PlanError(f"{at}: a station without {tag}")
                continue
            factor = _factor(what, element.get("uom", "").lower(), at)
            values[what] = _number(element.text or "", f"{at}: {tag}") * factor
        rows.append(_Row(line, **values))
    return _plan(
        rows, reference if reference in _NORTHS else "", trajectory.findtext(f"{WITSML}name", "").strip() or name
    )


def _columns(cells: list[str], at: str) -> tuple[dict[str, int], dict[str, str], str]:
    columns: dict[str, int] = {}
    units: dict[str, str] = {}
    north = ""
    for k, cell in enumerate(cells):
        words = [w for w in re.split(r"[^a-z]+", cell.lower()) if w]
        unit = words.pop() if len(words) > 1 and words[-1] in {**_UNITS, **_ANGLES} else ""
        norths = [w for w in words if w in _NORTHS]
        what = _NAMES.get("_".join(w for w in words if w not in _NORTHS), "")
        if not what or what in columns:
            continue
        columns[what] = k
        units[what] = unit
        if what == "azimuth" and norths:
            north = norths[0]
    missing = [w for w in ("md", "inclination", "azimuth") if w not in columns]
    if missing:
        raise PlanError(
            f"{at}: no column for {', '.join(missing)}; expected a header such as md_m,inclination_deg,azimuth_deg,"
            f" got {', '.join(cells)}"
        )
    return columns, units, north


def _factor(what: str, unit: str, at: str) -> float:
    known = _ANGLES if what in ("inclination", "azimuth") else _UNITS
    if known is _ANGLES and not unit:
        return _ANGLES["deg"]
    if not unit:
        raise PlanError(f"{at}: {what} has no unit; write {what}_m or {what}_ft")
    if unit not in known:
        raise PlanError(f"{at}: {what} in {unit!r}; expected one of {', '.join(known)}")
    return known[unit]


def _fields(line: str, separator: str, at: str) -> list[str]:
    try:
        cells = [c.strip() for c in next(csv.reader([line], delimiter=separator))]
    except csv.Error as error:
        raise PlanError(f"{at}: {error}") from error
    return cells if separator == "," else [c.replace(",", ".") for c in cells]


def _row(cells: list[str], columns: dict[str, int], factors: dict[str, float], at: str, line: int) -> _Row:
    values = {}
    for what, k in columns.items():
        if k >= len(cells):
            raise PlanError(f"{at}: {len(cells)} fields, the header names {what} as number {k + 1}")
        values[what] = _number(cells[k], f"{at}: {what}") * factors[what]
    return _Row(line, **values)


def _number(text: str, at: str) -> float:
    if not _is_number(text):
        raise PlanError(f"{at}: expected a finite number, got {text!r}")
    return float(text)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _plan(rows: list[_Row], north: str, name: str) -> Plan:
    if len(rows) < 2:
        where = f", line {rows[0].line}" if rows else ""
        raise PlanError(f"{name}{where}: a plan needs at least two stations, got {len(rows)}")
    for before, row in zip([None, *rows], rows, strict=False):
        at = f"{name}, line {row.line}"
        if not 0.0 <= row.inclination <= math.pi:
            shown = math.degrees(row.inclination)
            raise PlanError(
                f"{at}: inclination {shown:g} deg is outside 0 to 180; is it in degrees, from the vertical?"
            )
        if not -math.pi <= row.azimuth <= math.tau:
            raise PlanError(f"{at}: azimuth {math.degrees(row.azimuth):g} deg is outside -180 to 360")
        if before is not None and row.md <= before.md:
            raise PlanError(f"{at}: measured depth {row.md:g} m does not increase after {before.md:g} m")
    first = rows[0]
    start = None
    if first.tvd is not None:
        start = (first.north or 0.0, first.east or 0.0, first.tvd)
    try:
        plan = plan_of(
            [r.md for r in rows],
            [r.inclination for r in rows],
            [r.azimuth % math.tau for r in rows],
            start,
            north,
            name,
        )
    except ValueError as error:
        raise PlanError(f"{name}: {error}") from error
    for k, row in enumerate(rows):
        for what, given, got in zip(
            ("north", "east", "tvd"), (row.north, row.east, row.tvd), plan.positions[k], strict=True
        ):
            # Plans by other methods differ by decimetres; another unit or north by much more.
            allowed = 1.0 + 0.005 * (row.md - first.md)
            if given is not None and abs(given - got) > allowed and (what == "tvd" or start is not None):
                raise PlanError(
                    f"{name}, line {row.line}: {what} {given:.2f} m does not fit the angles, which give"
                    f" {float(got):.2f} m; check units and north"
                )
    return plan
