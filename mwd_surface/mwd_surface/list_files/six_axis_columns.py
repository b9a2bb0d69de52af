# SPDX-License-Identifier: Apache-2.0
"""
Meaning and units of the columns of a table of six-axis readings.

Names are read without regard to case, spaces and brackets: ``grav_axial_mps2``, ``Grav Axial (m/s2)`` and
``GRAV_AXIAL`` are the same quantity. A unit stands at the end of the name. If the names have no unit, the unit of a
sensor is inferred from the size of the total acceleration or field.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.list_files.list_columns import ANGLE_UNITS, LENGTH_UNITS

_AXES = ("axial", "tran1", "tran2")
_ACCELERATION = {
    "mps2": 1.0,
    "m_s2": 1.0,
    "ms2": 1.0,
    "g": STANDARD_GRAVITY,
    "mg": 1e-3 * STANDARD_GRAVITY,
    "gn": STANDARD_GRAVITY,
}
_FIELD = {"nt": 1e-9, "ut": 1e-6, "mt": 1e-3, "t": 1.0, "gauss": 1e-4, "mgauss": 1e-7}


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
_DOWN = ("grav", "gravity", "g")
_UP = ("accel", "acc", "specific_force", "f", "linear_acceleration", "a")
_MAGNETIC = ("mag", "magnetic_field", "b", "h", "m")

_REFERENCES = {
    "total": _Quantity(
        "reference field strength",
        _FIELD,
        ("b_ref", "bref", "field_ref", "b_total_ref", "btotal_ref", "mag_total_ref", "ref_b"),
    ),
    "dip": _Quantity("reference dip", ANGLE_UNITS, ("dip_ref", "ref_dip", "dipref", "mag_dip_ref")),
    "gravity": _Quantity(
        "reference gravity", _ACCELERATION, ("g_ref", "gref", "grav_total_ref", "gravity_ref", "ref_g")
    ),
    "declination": _Quantity(
        "declination", ANGLE_UNITS, ("decl_used", "decl", "declination", "mag_decl", "decl_ref", "mag_declination")
    ),
    "convergence": _Quantity(
        "grid convergence",
        ANGLE_UNITS,
        ("grid_cor_used", "convergence", "grid_convergence", "grid_con", "grid_cor", "conv"),
    ),
}
_AZIMUTHS = ("azi", "az", "azim", "azimuth", "hole_azimuth")
_NORTHS = {"grid": ("grid", "gn", "g"), "true": ("true", "tn", "t"), "magnetic": ("mag", "magnetic", "mn", "m")}
_DEPTH = _Quantity("measured depth", LENGTH_UNITS, ("md", "measured_depth", "depth", "bit_depth", "survey_depth"))
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
_TIME = ("dtim_utc", "dtim", "time", "time_utc", "date_time", "datetime", "timestamp", "stamp_ns", "utc")


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
    assumed: tuple[str, ...]  #: sentences on the units that the column names do not state
    printed: Mapping[str, str]  #: key of `_PRINTED` (inclination, azimuth, azimuth_true ...) -> column


def find_columns(table: Mapping[str, Sequence[Any]], axial: str | None = None) -> SixAxisColumns:
    """
    Return the columns of a table by quantity, with their factors to SI units.

    table, axial: as in `six_axis_table.table_rows`. Raises ValueError if a sensor axis is missing, a quantity is given
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
    depth = _match([name for name in names if name not in factors], _DEPTH)
    if depth:
        factors[depth] = _factor(table, depth, _DEPTH, assumed)
    time = next((name for name in names if _plain(name) in _TIME), None)
    run = tuple(name for words in (_RUN, _TOOL) for name in names if _plain(name) in words and name not in factors)
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
    assumed.append(f"{', '.join(three)}: taken as {words} by their size")
    return dict.fromkeys(three, factor)


def _plain(name: str) -> str:
    """Return a name in lower case, with words joined by underscores and without brackets and signs."""
    name = name.strip().lower().replace("\u00b2", "2").replace("^", "").replace("m/s/s", "mps2").replace("m/s2", "mps2")
    return re.sub(r"[^a-z0-9]+", "_", name).strip("_")


def _unit(name: str, units: Mapping[str, float]) -> str | None:
    """Return the unit at the end of a column name; None if it ends with none of these units."""
    plain = _plain(name)
    return max((unit for unit in units if plain.endswith("_" + unit)), key=len, default=None)


def _stem(name: str, units: Mapping[str, float]) -> str:
    plain, unit = _plain(name), _unit(name, units)
    return plain[: -len(unit) - 1] if unit else plain


def _found(names: Sequence[str], quantity: _Quantity) -> list[str]:
    """Return the columns whose name is a name of the quantity."""
    return [name for name in names if _stem(name, quantity.units) in quantity.names or _plain(name) in quantity.names]


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
        return f"{words}: columns {', '.join(by_letter)} do not say which letter runs down-hole: say axial x or axial z"
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
    raise ValueError(f"{', '.join(three)}: unit unknown and a total of {total:g} fits none: put the unit in the name")


def _factor(table: Mapping[str, Sequence[Any]], name: str, quantity: _Quantity, assumed: list[str]) -> float:
    unit = _unit(name, quantity.units)
    if unit:
        return quantity.units[unit]
    if quantity.units is _FIELD or quantity.units is _ACCELERATION:
        kind = "field" if quantity.units is _FIELD else "acceleration"
        factor, words = _guess(table, (name,), kind)
    else:
        words, factor = ("deg", ANGLE_UNITS["deg"]) if quantity.units is ANGLE_UNITS else ("m", 1.0)
    assumed.append(f"{name}: taken as {words}")
    return factor


def numbers(table: Mapping[str, Sequence[Any]], name: str, rows: int, factor: float) -> Array:
    """
    Return a column as numbers in SI; empty or unreadable cells are nan.

    Raises ValueError if the column does not have `rows` cells.
    """
    cells = table[name]
    if len(cells) != rows:
        raise ValueError(f"{name}: {len(cells)} values where the other columns have {rows}")
    return np.array([_number(cell) for cell in cells]) * factor


def _number(cell: Any) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return math.nan
