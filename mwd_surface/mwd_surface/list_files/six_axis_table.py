# SPDX-License-Identifier: Apache-2.0
"""
Conversion of a table of six-axis readings to survey stations: readings, reference, run and station of each row.

`six_axis_columns` finds the meaning and unit of each column.
"""

from __future__ import annotations

import math
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
from mwd_surface.list_files import table_wiring
from mwd_surface.list_files.list_rows import station_rows
from mwd_surface.list_files.moments import dated
from mwd_surface.list_files.number_cells import is_null, looks_like_number
from mwd_surface.list_files.remark import Remark
from mwd_surface.list_files.six_axis_columns import (
    SixAxisColumns,
    find_columns,
    is_unit,
    names_quantities,
    numbers,
    time_columns,
)
from mwd_surface.list_files.table import read_table

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
    first: Station | None = None  #: result from this and earlier stations of the run only; None if computed alone
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
