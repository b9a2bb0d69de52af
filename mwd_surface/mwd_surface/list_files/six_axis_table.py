# SPDX-License-Identifier: Apache-2.0
"""
Table of six-axis readings: meaning and units of its columns, and the reading, reference, run and station of each row.

Names are read without regard to case, spaces, brackets and the order of their words: ``grav_axial_mps2``, ``Axial
Gravity (m/s2)`` and ``GRAV_AXIAL`` are the same quantity. A unit stands at the end of the name. If the names have no
unit, the unit of a sensor is inferred from the size of the total acceleration or field. The depth is found as in lists
of stations.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mwd_estimation.core.reasons import Reason
from mwd_estimation.core.reasons import ReasonCode as Code
from mwd_estimation.core.reference_field import NORTHS, Reference, best_north, north_correction
from mwd_estimation.survey.station import Station, StationSettings, station
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.list_files import list_columns, table_wiring
from mwd_surface.list_files.list_columns import ANGLE_UNITS, LENGTH_UNITS
from mwd_surface.list_files.list_rows import station_rows
from mwd_surface.list_files.moments import dated
from mwd_surface.list_files.number_cells import decimal_mark, is_null, looks_like_number, split, value
from mwd_surface.list_files.remark import Remark
from mwd_surface.list_files.table import read_table

_AXES = ("axial", "tran1", "tran2")
_AXIS_LETTERS = tuple(zip(_AXES, "xyz", strict=True))
_LEAST_NAMES = 4  # smallest number of known names in the line that names the columns
_SAME_DEPTH = 0.02  # largest difference of two columns of the same depth, m; feet are often rounded to 0.1
_ACCELERATION = {
    "mps2": 1.0,
    "m_s2": 1.0,
    "ms2": 1.0,
    "g": STANDARD_GRAVITY,
    "mg": 1e-3 * STANDARD_GRAVITY,
    "gn": STANDARD_GRAVITY,
    "ftps2": 0.3048,
}
_FIELD = {
    "nt": 1e-9,
    "ut": 1e-6,
    "mt": 1e-3,
    "t": 1.0,
    "gamma": 1e-9,
    **dict.fromkeys(("gauss", "g"), 1e-4),
    **dict.fromkeys(("mgauss", "mg"), 1e-7),
}


@dataclass(frozen=True)
class _Quantity:
    words: str
    units: Mapping[str, float]
    names: tuple[str, ...]


def _sensor_names(stems: Sequence[str], axis: str, letter: str) -> tuple[str, ...]:
    """
    Return the possible column names of one axis of a sensor: by its role in the tool, and by its letter.

    The caller decides which letter has which role.
    """
    roles = {"axial": ("axial", "ax", "long"), "tran1": ("tran1", "trans1", "t1"), "tran2": ("tran2", "trans2", "t2")}
    by_role = [f"{stem}_{role}" for stem in stems for role in roles[axis]]
    return (*by_role, *(f"{stem}{join}{letter}" for stem in stems for join in ("_", "")))


# Beginnings of column names: gravity (down at rest), specific force (up at rest), magnetic field.
_DOWN = ("grav", "g")
_UP = ("accel", "acc", "specific_force", "f", "linear_accel", "a")
_MAGNETIC = ("mag", "mag_field", "b", "h", "m")
# Words of names with the same meaning.
_SYNONYMS = {
    **dict.fromkeys(("reference", "expected", "nominal"), "ref"),
    **dict.fromkeys(("magnetic", "magnetometer"), "mag"),
    **dict.fromkeys(("gravity",), "grav"),
    **dict.fromkeys(("accelerometer", "acceleration"), "accel"),
    **dict.fromkeys(("declination", "dec"), "decl"),
    **dict.fromkeys(("convergence", "con"), "conv"),
}

_REFERENCES = {
    "total": _Quantity(
        "reference field strength",
        _FIELD,
        (
            *("b_ref", "bref", "field_ref", "field_total_ref", "field_strength_ref", "mag_field_ref"),
            *("mag_field_strength_ref", "b_total_ref", "btotal_ref", "mag_total_ref"),
        ),
    ),
    "dip": _Quantity("reference dip", ANGLE_UNITS, ("dip_ref", "dipref", "mag_dip_ref")),
    "gravity": _Quantity(
        "reference gravity", _ACCELERATION, ("g_ref", "gref", "g_total_ref", "gtotal_ref", "grav_total_ref", "grav_ref")
    ),
    "declination": _Quantity(
        "declination", ANGLE_UNITS, ("decl_used", "decl", "declination", "mag_decl", "decl_ref", "mag_declination")
    ),
    "convergence": _Quantity(
        "grid convergence",
        ANGLE_UNITS,
        ("grid_cor_used", "grid_conv", "grid_cor", "conv"),
    ),
}
_AZIMUTHS = ("azi", "az", "azim", "azimuth", "hole_azimuth")
_NORTHS = {"grid": ("grid", "gn", "g"), "true": ("true", "tn", "t"), "magnetic": ("mag", "mn", "m")}
_BIT = _Quantity("depth of the bit", LENGTH_UNITS, ("bit_depth", "bit_md"))
# Angles given in the table; they show whether axes and signs of the sensor columns are correct.
_PRINTED = {
    "inclination": _Quantity(
        "inclination", ANGLE_UNITS, ("incl", "inc", "inclination", "incl_deg", "hole_inclination", "dev", "deviation")
    ),
    **{
        f"azimuth_{north}": _Quantity(
            f"azimuth from {north} north", ANGLE_UNITS, tuple(f"{word}_{name}" for word in _AZIMUTHS for name in names)
        )
        for north, names in _NORTHS.items()
    },
    "azimuth": _Quantity("azimuth", ANGLE_UNITS, _AZIMUTHS),
}
# Column names of the run or assembly, and of the tool; their values are the same within a run.
_RUN = ("run", "run_no", "run_number", "run_id", "bha", "bha_no", "bha_number", "bha_run", "assembly")
_TOOL = ("tool", "tool_id", "tool_no", "tool_serial", "serial", "serial_no", "sonde")
_TIME = ("dtim_utc", "dtim", "time", "time_utc", "date_time", "datetime", "timestamp", "stamp_ns", "utc", "survey_time")
_DATE = ("date", "date_utc", "survey_date")


@dataclass(frozen=True)
class SixAxisColumns:
    """Names of the columns that hold each quantity."""

    #: `gravity`, `field`: columns of the axial and the two transverse axes.
    gravity: tuple[str, str, str]
    field: tuple[str, str, str]
    #: -1 if the gravity columns point down at rest (they are turned into specific force), +1 if they are specific
    #: force.
    sign: float
    references: Mapping[str, str]  #: field of `Reference` -> column
    depth: str | None
    time: str | None
    run: tuple[str, ...]  #: columns that name the assembly or run, and the tool; constant within a run
    factors: Mapping[str, float]  #: column -> factor to SI units
    assumed: tuple[str, ...]  #: sentences on the units that the column names do not state, and on a missing depth
    printed: Mapping[str, str]  #: key of `_PRINTED` (inclination, azimuth, azimuth_true ...) -> column


def find_columns(table: Mapping[str, Sequence[Any]], axial: str | None = None) -> SixAxisColumns:
    """
    Return the columns of a table by quantity, with their factors to SI units.

    table, axial: as in `table_rows`. Raises ValueError if a sensor axis is missing, a quantity is given
    twice, or a unit cannot be inferred.
    """
    if axial not in (None, "x", "z"):
        raise ValueError(f"axial: {axial!r} is not x or z")
    names = list(table)
    down, up = _triad(names, _DOWN, _ACCELERATION, axial), _triad(names, _UP, _ACCELERATION, axial)
    if down and up:
        raise ValueError(f"gravity is given twice: {', '.join(down)} and {', '.join(up)}; leave one of them out")
    gravity, field = down or up, _triad(names, _MAGNETIC, _FIELD, axial)
    if gravity is None:
        raise ValueError(_missing(names, "gravity", _DOWN + _UP, axial))
    if field is None:
        raise ValueError(_missing(names, "magnetic field", _MAGNETIC, axial))
    assumed: list[str] = []
    factors = _triad_factors(table, gravity, _ACCELERATION, "acceleration", assumed)
    factors |= _triad_factors(table, field, _FIELD, "field", assumed)
    references: dict[str, str] = {}
    for key, quantity in _REFERENCES.items():
        match = _match([name for name in names if name not in factors], quantity)
        if match:
            references[key] = match
            factors[match] = _factor(table, match, quantity, assumed)
    printed: dict[str, str] = {}
    for key, quantity in _PRINTED.items():
        match = _first([name for name in names if name not in factors], quantity)
        if match:
            printed[key] = match
            factors[match] = _factor(table, match, quantity, [])
    depth = _depth(table, [name for name in names if name not in factors], factors, assumed)
    time = _named(names, _TIME) or _named(names, _DATE)
    run = tuple(name for words in (_RUN, _TOOL) for name in names if _plain(name) in words and name not in factors)
    if depth is None:
        used = {*factors, *time_columns(names), *run}
        unused = ", ".join(name for name in names if name not in used) or "none"
        assumed.append(
            "the surveys have no depth, because no column of the measured depth was found: name it md_m or md_ft; "
            f"columns that are not used: {unused}"
        )
    return SixAxisColumns(
        gravity=gravity,
        field=field,
        sign=-1.0 if down else 1.0,
        references=references,
        depth=depth,
        time=time,
        run=run,
        factors=factors,
        assumed=tuple(assumed),
        printed=printed,
    )


def names_quantities(names: Sequence[str]) -> int:
    """Return the number of names that are quantities of a table of readings; 0 if they are too few for its header."""
    known = [
        *(_Quantity("", _ACCELERATION, _sensor_names((*_DOWN, *_UP), axis, letter)) for axis, letter in _AXIS_LETTERS),
        *(_Quantity("", _FIELD, _sensor_names(_MAGNETIC, axis, letter)) for axis, letter in _AXIS_LETTERS),
        *_REFERENCES.values(),
        *_PRINTED.values(),
    ]
    plain = [str(name) for name in names]
    found = {name for quantity in known for name in _found(plain, quantity)}
    found |= {name for k, name in enumerate(plain) if list_columns.column_of(k, name).quantity == "md"}
    return len(found) if len(found) >= _LEAST_NAMES else 0


def is_unit(text: str) -> bool:
    """Return whether a text is a unit of a quantity of such a table."""
    units = (_ACCELERATION, _FIELD)
    return any(_plain(text) in known for known in units) or bool(list_columns.unit_word(text))


def time_columns(names: Sequence[str]) -> tuple[str, str]:
    """Return the column of the time and the separate column of its date; "" for a column that does not exist."""
    return _named(names, _TIME) or "", _named(names, _DATE) or ""


def _named(names: Sequence[str], known: Sequence[str]) -> str | None:
    return next((name for name in names if _plain(name) in known), None)


def _depth(
    table: Mapping[str, Sequence[Any]], names: Sequence[str], factors: dict[str, float], assumed: list[str]
) -> str | None:
    """
    Return the column of the measured depth, by the names and units of lists of stations, and add its factor to m.

    Without such a column, the depth of the bit is used. Raises ValueError if a unit is not recognised, or if two
    columns differ.
    """
    found = list(list_columns.find(names).of.get("md", ()))
    if not found:
        bit = _match(names, _BIT)
        if bit:
            factors[bit] = _factor(table, bit, _BIT, assumed)
            assumed.append(f"{bit}: used as the depth of the survey, because the table has no other depth")
        return bit
    # A column that states its unit comes first.
    found.sort(key=lambda one: not one.unit)
    for one in found:
        if one.strange or one.unit not in (*LENGTH_UNITS, ""):
            raise ValueError(f"{one.name}: {one.strange or one.unit!r} was not recognised; write md_m or md_ft")
    depths = []
    for one in found:
        name, factor = names[one.number], LENGTH_UNITS.get(one.unit, 1.0)
        depths.append(numbers(table, name, len(table[name]), factor))
        if np.nanmax(np.abs(depths[-1] - depths[0]), initial=0.0) > _SAME_DEPTH:
            raise ValueError(
                f"measured depth is given twice: {names[found[0].number]} and {name}; leave one of them out"
            )
    name = names[found[0].number]
    factors[name] = LENGTH_UNITS.get(found[0].unit, 1.0)
    if not found[0].unit:
        assumed.append(f"{name}: read as m")
    return name


def _triad(
    names: Sequence[str], stems: Sequence[str], units: Mapping[str, float], axial: str | None
) -> tuple[str, str, str] | None:
    """
    Return the columns of the axial and the two transverse axes of one sensor; None if one of them is missing.

    Raises ValueError if several columns have the same axis.
    """
    # The letters are in right-handed order, with the letter of the axis that runs down-hole first.
    letters = {"x": ("x", "y", "z"), "z": ("z", "x", "y"), None: ("", "", "")}[axial]
    found = []
    for axis, letter in zip(_AXES, letters, strict=True):
        aliases = _sensor_names(stems, axis, letter or "\0")
        match = _match(names, _Quantity(f"{axis} axis", units, aliases))
        if match is None:
            return None
        found.append(match)
    return found[0], found[1], found[2]


def _triad_factors(
    table: Mapping[str, Sequence[Any]],
    three: tuple[str, str, str],
    units: Mapping[str, float],
    kind: str,
    assumed: list[str],
) -> dict[str, float]:
    """
    Return factors to SI for the columns of a sensor, from their units or from the size of the total.

    Raises ValueError if only some of the columns have a unit.
    """
    given = [_unit(name, units) for name in three]
    if all(given):
        return {name: units[unit] for name, unit in zip(three, given, strict=True) if unit}
    if any(given):
        raise ValueError(f"{', '.join(three)}: give all three axes a unit, or none")
    factor, words = _guess(table, three, kind)
    assumed.append(f"{', '.join(three)}: read as {words}, because of the size of the values")
    return dict.fromkeys(three, factor)


def _plain(name: str) -> str:
    """Return a name in lower case, with words joined by underscores and without brackets and signs."""
    # A letter of an axis may be joined to the name of the sensor, as in xAccel.
    name = re.sub(r"^([xyzXYZ])(?=[A-Z][a-z])", r"\1_", name.strip()).lower()
    name = name.translate({0xB2: "2", 0xB5: "u", 0x3BC: "u", ord("^"): None})
    name = re.sub(r"\b(m|ft)/s(?:ec)?(?:2|/s(?:ec)?)", r"\1ps2", name)
    return re.sub(r"[^a-z0-9]+", "_", name).strip("_")


def _key(plain: str) -> frozenset[str]:
    """Return the words of a name from `_plain`, without their order and in one form for each meaning."""
    return frozenset(_SYNONYMS.get(word, word) for word in plain.split("_"))


def _unit(name: str, units: Mapping[str, float]) -> str | None:
    """Return the unit at the end of a column name; None if it ends with none of these units."""
    plain = _plain(name)
    return max((unit for unit in units if plain.endswith("_" + unit)), key=len, default=None)


def _stem(name: str, units: Mapping[str, float]) -> str:
    plain, unit = _plain(name), _unit(name, units)
    return plain[: -len(unit) - 1] if unit else plain


def _found(names: Sequence[str], quantity: _Quantity) -> list[str]:
    """Return the columns whose name is a name of the quantity."""
    known = {_key(name) for name in quantity.names}
    return [name for name in names if _key(_stem(name, quantity.units)) in known or _plain(name) in quantity.names]


def _first(names: Sequence[str], quantity: _Quantity) -> str | None:
    """Return the first column of a quantity; None if the table has no such column."""
    return next(iter(_found(names, quantity)), None)


def _match(names: Sequence[str], quantity: _Quantity) -> str | None:
    """Return the only column of a quantity; None if the table has none. Raises ValueError if there are several."""
    found = _found(names, quantity)
    if len(found) > 1:
        raise ValueError(f"{quantity.words} is given twice: {' and '.join(found)}; leave one of them out")
    return found[0] if found else None


def _missing(names: Sequence[str], words: str, stems: Sequence[str], axial: str | None) -> str:
    """Return a message for a missing sensor triad, with similar names or the option that says which letter is axial."""
    lettered = {f"{stem}{join}{letter}" for stem in stems for join in ("_", "") for letter in "xyz"}
    units = _FIELD if words == "magnetic field" else _ACCELERATION
    by_letter = [name for name in names if _stem(name, units) in lettered]
    if axial is None and len(by_letter) >= 3:
        return f"{words}: columns {', '.join(by_letter)} do not show which axis points down-hole: set axial to x or z"
    suffix = "nt" if words == "magnetic field" else "mps2"
    wanted = [f"{stems[0]}_{axis}_{suffix}" for axis in _AXES]
    missing = [name for name in wanted if _stem(name, units) not in {_stem(other, units) for other in names}]
    near = {
        name: difflib.get_close_matches(name, [_plain(other) for other in names], n=2, cutoff=0.6) for name in missing
    }
    hints = [f"{name} (is it {' or '.join(close)}?)" if close else name for name, close in near.items()]
    return f"{words}: no column {', '.join(hints)}; the table has {', '.join(names)}"


def _guess(table: Mapping[str, Sequence[Any]], three: Sequence[str], kind: str) -> tuple[float, str]:
    """Return the unit of columns, factor to SI and name, from their median total; raise ValueError if no unit fits."""
    rows = len(table[three[0]])
    total = float(np.nanmedian(np.linalg.norm([numbers(table, name, rows, 1.0) for name in three], axis=0)))
    ranges = {
        "acceleration": (
            (1.0, "m/s^2", 8.0, 12.0),
            (STANDARD_GRAVITY, "g", 0.8, 1.2),
            (1e-3 * STANDARD_GRAVITY, "mg", 8e2, 1.2e3),
        ),
        "field": (
            (1e-9, "nT", 15e3, 1e5),
            (1e-6, "uT", 15.0, 100.0),
            (1e-4, "gauss", 0.15, 1.0),
            (1.0, "T", 1.5e-5, 1e-4),
        ),
    }
    for factor, words, low, high in ranges[kind]:
        if low <= total <= high:
            return factor, words
    raise ValueError(
        f"{', '.join(three)}: no unit is named, and the total of {total:g} fits none: write the unit into the names"
    )


def _factor(table: Mapping[str, Sequence[Any]], name: str, quantity: _Quantity, assumed: list[str]) -> float:
    unit = _unit(name, quantity.units)
    if unit:
        return quantity.units[unit]
    if quantity.units is _FIELD or quantity.units is _ACCELERATION:
        kind = "field" if quantity.units is _FIELD else "acceleration"
        factor, words = _guess(table, (name,), kind)
    else:
        words, factor = ("deg", ANGLE_UNITS["deg"]) if quantity.units is ANGLE_UNITS else ("m", 1.0)
    assumed.append(f"{name}: read as {words}")
    return factor


def numbers(table: Mapping[str, Sequence[Any]], name: str, rows: int, factor: float) -> Array:
    """
    Return a column as numbers in SI; empty or unreadable cells are nan.

    Raises ValueError if the column does not have `rows` cells.
    """
    cells = table[name]
    if len(cells) != rows:
        raise ValueError(f"{name}: {len(cells)} values where the other columns have {rows}")
    return np.array([_number(cell, factor) for cell in cells]) * factor


def _number(cell: Any, factor: float) -> float:
    """
    Return the number in a cell, nan without one.

    The number may have the unit of its column, or a direction as in a declination of 2.2 W.
    """
    try:
        return float(cell)
    except (TypeError, ValueError):
        pass
    found = split(cell) if isinstance(cell, str) and not is_null(cell) else None
    if found is None:
        return math.nan
    try:
        number = value(found[0], decimal_mark(found[0]))
    except ValueError:
        return math.nan
    words = _plain(found[1])
    if words in ("e", "east", "w", "west") and number >= 0.0:
        return -number if words[0] == "w" else number
    same = any(known.get(words) == factor for known in (_ACCELERATION, _FIELD, LENGTH_UNITS, ANGLE_UNITS))
    return number if same else math.nan


Refine = Callable[[Reference, str], Reference]


@dataclass(frozen=True)
class TableRow:
    """One row as read from the table."""

    md: float  #: measured depth, m; nan if the table has none
    #: `time`, `run`: texts as written; `run` joins run and tool and is empty if the table names neither.
    time: str
    run: str
    #: `f_t`, `b_t`: shape (3,); specific force, m/s^2, and field, T, in tool axes; nan if a cell cannot be read.
    f_t: Array
    b_t: Array
    reference: Reference | None
    faults: tuple[Reason, ...] = ()  #: why the row is not a station
    #: `inclination`, `azimuth`: angles given in the table, rad, the azimuth from magnetic north; nan if not given.
    inclination: float = math.nan
    azimuth: float = math.nan


@dataclass(frozen=True)
class TableStation:
    """One row with its computed station."""

    #: `md`, `time`, `run`: see `TableRow`.
    md: float
    time: str
    station: Station
    run: str = ""
    #: First value: result from this station and the earlier stations of the run. None if the station was computed
    #: without other stations.
    first: Station | None = None
    outlier: bool = False  #: whether the field disagrees with the other stations of the run


def single_stations(rows: Sequence[TableRow], settings: StationSettings | None = None) -> list[TableStation]:
    """Return the stations of the rows, each computed without the other rows."""
    return [
        TableStation(row.md, row.time, station(row.f_t, row.b_t, row.reference, settings, faults=row.faults), row.run)
        for row in rows
    ]


def read_readings(path: Path, axial: str | None = None) -> tuple[dict[str, list[str]], tuple[Remark, ...]]:
    """
    Return the columns of a file with a table of readings by name, and remarks on what was left out.

    The names are found below titles. Units in a line below the names become part of the names, times become ISO 8601,
    and rows that are notes or totals are left out.

    Raises
    ------
    ValueError
        As `table.read_table` and `find_columns`.
    """
    table = read_table(path, names_quantities, _are_units)
    names = tuple(
        f"{name} ({unit})" if is_unit(unit) else name for name, unit in zip(table.names, table.units, strict=True)
    )
    table = replace(table, names=names)
    found = find_columns(table.columns(), axial)
    remarks = table.remarks
    if found.depth:
        rows, left_out = station_rows(
            path.name, table.rows, [names.index(name) for name in (found.depth, *found.gravity, *found.field)]
        )
        table, remarks = replace(table, rows=tuple(rows)), (*remarks, *left_out)
    columns = table.columns()
    time, date = time_columns(names)
    if time or date:
        days, clocks = (columns[name] if name else [""] * len(table.rows) for name in (date, time))
        columns[time or date] = dated(days, clocks)
    return columns, remarks


def _are_units(cells: Sequence[str]) -> int:
    words = [str(cell) for cell in cells]
    return int(any(map(is_unit, words)) and not any(map(looks_like_number, words)))


def table_rows(
    table: Mapping[str, Sequence[Any]],
    override: Reference | None = None,
    *,
    axial: str | None = None,
    refine: Refine | None = None,
    run: str | None = None,
) -> list[TableRow]:
    """
    Return the rows of a six-axis table, in SI units.

    If the sensor columns of a run have the wrong handedness, sign, order or unit, or a dead axis, all rows of the run
    get this fault.

    Parameters
    ----------
    table : mapping of str to sequence
        Columns by name.
    override : Reference, optional
        Reference whose values replace those of the table; its missing values come from the table.
    axial : str, optional
        Letter of the axis that runs down-hole, x or z, for columns named by letters.
    refine : callable, optional
        Function that returns the reference to use, given the reference and the time of a row.
    run : str, optional
        Column that names the run of a row, instead of the columns recognised by name.

    Raises
    ------
    ValueError
        A column is missing, given twice, of another length or of an unknown unit, or the reference of a row contradicts
        itself.
    """
    columns = find_columns(table, axial)
    if run is not None:
        if run not in table:
            raise ValueError(f"run: there is no column {run!r}; the table has {', '.join(table)}")
        columns = replace(columns, run=(run,))
    count = len(table[columns.gravity[0]])
    values = {name: numbers(table, name, count, factor) for name, factor in columns.factors.items()}
    return _wired([_read(table, columns, values, row, override, refine) for row in range(count)], columns)


def _wired(rows: list[TableRow], columns: SixAxisColumns) -> list[TableRow]:
    """Return the rows with the faults of the sensor columns of their run added."""
    found = list(rows)
    for name in dict.fromkeys(row.run for row in rows):
        at = [k for k, row in enumerate(rows) if row.run == name]
        of_run = [rows[k] for k in at]
        known = [row.reference for row in of_run if row.reference is not None and row.reference.has_field]
        totals = [reference.total for reference in known if reference.total is not None]
        faults = table_wiring.wiring_faults(
            table_wiring.accelerometers(
                columns.gravity, np.stack([row.f_t for row in of_run]), columns.factors[columns.gravity[0]]
            ),
            table_wiring.magnetometers(
                columns.field,
                np.stack([row.b_t for row in of_run]),
                float(np.median(totals)) if totals else math.nan,
                columns.factors[columns.field[0]],
            ),
            table_wiring.ExpectedRows(
                np.array([row.md for row in of_run]),
                np.array([_dip(row.reference) for row in of_run]),
                np.array([row.inclination for row in of_run]),
                np.array([row.azimuth for row in of_run]),
            ),
        )
        for k in at:
            found[k] = replace(rows[k], faults=(*rows[k].faults, *faults))
    return found


def _dip(reference: Reference | None) -> float:
    return math.nan if reference is None or reference.dip is None else reference.dip


def _read(
    table: Mapping[str, Sequence[Any]],
    columns: SixAxisColumns,
    values: Mapping[str, Array],
    row: int,
    override: Reference | None,
    refine: Refine | None,
) -> TableRow:
    """Return one row; `values` holds every column in SI. Raises ValueError if its reference contradicts itself."""
    known = {
        key: float(values[name][row]) for key, name in columns.references.items() if math.isfinite(values[name][row])
    }
    time = str(table[columns.time][row]) if columns.time else ""
    for name in (*columns.references.values(), *filter(None, [columns.depth])):
        cell = table[name][row]
        if math.isnan(values[name][row]) and not is_null(str(cell)) and any(c.isdigit() for c in str(cell)):
            raise ValueError(f"row {row + 1}: {name}: {cell!r} is not a number")
    try:
        reference = _merged(known, override)
        reference = refine(reference, time) if refine is not None and reference is not None else reference
    except ValueError as error:
        raise ValueError(f"row {row + 1}: {error}") from error
    sensors = (*columns.gravity, *columns.field)
    inclination, azimuth = _printed(columns, values, row, reference)
    bad = tuple(name for name in values if name in sensors and not math.isfinite(values[name][row]))
    return TableRow(
        md=float(values[columns.depth][row]) if columns.depth else math.nan,
        time=time,
        run=", ".join(str(table[name][row]).strip() for name in columns.run),
        f_t=columns.sign * np.array([values[name][row] for name in columns.gravity]),
        b_t=np.array([values[name][row] for name in columns.field]),
        reference=reference,
        faults=(Reason(Code.NO_NUMBER, names=bad),) if bad else (),
        inclination=inclination,
        azimuth=azimuth,
    )


def _printed(
    columns: SixAxisColumns, values: Mapping[str, Array], row: int, reference: Reference | None
) -> tuple[float, float]:
    """Return the inclination, and the azimuth from magnetic north, given in a row, rad; nan if not given."""

    def of(name: str) -> float:
        return float(values[columns.printed[name]][row]) if name in columns.printed else math.nan

    for north in NORTHS:
        turn, azimuth = north_correction(reference, north), of(f"azimuth_{north}")
        if turn is not None and math.isfinite(azimuth):
            return of("inclination"), azimuth - turn
    # An azimuth without a named north is assumed to be from `best_north`.
    return of("inclination"), of("azimuth") - (north_correction(reference, best_north(reference)) or 0.0)


def _merged(known: Mapping[str, float], override: Reference | None) -> Reference | None:
    """
    Return the reference of one row: the override completed by the columns of the row.

    None if neither has a value.
    """
    if override is not None:
        fill: dict[str, Any] = {key: value for key, value in known.items() if getattr(override, key) is None}
        return replace(override, **fill)
    if not known:
        return None
    row: dict[str, Any] = {**known, "source": "table"}
    return Reference(**row)
