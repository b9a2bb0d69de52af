# SPDX-License-Identifier: Apache-2.0
"""
Columns of time and pressure in a table as a rig writes it: names, units and times of any usual kind.

The table layer of the lists finds encoding, separator, names and units in the first lines; the rows, which may be many
millions, are read by Arrow. A cell that is not a number is a missing sample and is counted. A historian writes a row
for each value of each of its tags (time, tag, value, quality); the rows of the tag of the pressure are the samples.
"""

from __future__ import annotations

import dataclasses
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mwd_sensors.core import budgets
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.budgets import BudgetError
from mwd_sensors.core.foreign_text import first_of
from mwd_sensors.core.input_files import check_regular, read_file
from mwd_surface.list_files import moments
from mwd_surface.list_files.exchange_formats import is_las, las_table
from mwd_surface.list_files.grid_file import Row, is_spreadsheet
from mwd_surface.list_files.number_cells import NULL_NUMBERS, Cell, decimal_mark, looks_like_number, split
from mwd_surface.list_files.table import Table, table_of
from mwd_surface.receiver import json_columns, table_times

_TITLES = 100  # lines of titles above the names
_HEAD = 20_000  # bytes in which names, units and the first rows stand
_FULL_SCALE = 1.0e7  # pressure at 20 mA of a gauge whose range is not known, Pa
# A current outside of 3.6 to 21 mA signals a failed gauge (NAMUR NE 43): shares of the ends of 4 to 20 mA. A range that
# begins at 0 has no lowest signal.
_FAILED_LOW, _FAILED_HIGH = 3.6 / 4.0, 21.0 / 20.0
_UNITS = {
    "pa": 1.0,
    "kpa": 1e3,
    "mpa": 1e6,
    "mbar": 100.0,
    "bar": 1e5,
    "bars": 1e5,
    "psi": 6894.757293168,
    "ksi": 6_894_757.293168,
    "hpa": 100.0,
    "atm": 101_325.0,
    "at": 98_066.5,
    "kgcm": 98_066.5,
    "kgfcm": 98_066.5,
}
# A unit may end with g (gauge) or a (absolute): a decoder uses changes of the pressure only.
PRESSURES = {
    **{unit + end: factor for unit, factor in _UNITS.items() for end in ("", "g", "a")},
    "v": 1.0,
    "mv": 1e-3,
    "ma": 1e-3,
}
_SIGNALS = ("v", "mv", "ma")  # units of signals of a gauge
_SAID = ("date", "time", "pressure", "pump", "rate", "decimal", "tag", "value")
_DECIMAL_MARKS = {"comma": ",", "point": "."}
_TIME = re.compile(
    r"^(?:rig |local |utc |gps |unix |elapsed |sample |log |server |source |measurement |measuring |test )?"
    r"(?:time ?stamp|time|ts|t|datetime|date ?/? ?time|epoch|stamp|clock|elapsed|etim|zeit\w*|uhrzeit|datum/uhrzeit|"
    r"tiempo|hora|temps|heure|horodatage|tid|tempo|时间|时刻|время)\b|^(?:seconds|hh? mm(?: ss)?)$"
)
_DATE = re.compile(
    r"^(?:date|day|日期|datum|fecha|dato|data|дата)\b|^(?:y{2,4}[/ ]mm[/ ]dd|[dm]{2}[/ ][dm]{2}[/ ]y{2,4})$"
)
# Names of the pressure that the tool modulates, of any pressure, and of pressures of other places.
_STANDPIPE = re.compile(r"stand ?pipe|\bspp|standrohr|立压|立管")
_PRESSURE = re.compile(r"press|druck|presion|presión|trykk|泵压|давл|voltage|\bvolts?\b|\bp\b|\bcurrent\b|\bloop\b")
_ELSEWHERE = re.compile(
    r"diff|annul|casing|choke|hydrostatic|downhole|bottom ?hole|\bbh|\bkill|cement|boost|\bmax|\bmin\b|hydraulic"
)
_AVERAGED = re.compile(r"\bavg\b|\baverage|\bmean\b|\bsmooth|\bfiltered\b")
_PUMP = re.compile(r"^(?:pump|pump no|pump number|泵)\b")
_QUALITY = re.compile(r"^(?:quality|qual|status|state|qualität)\b")
_BAD_QUALITY = 64  # lowest quality of a good sample, for OPC quality numbers and for percent
_GOOD_QUALITIES = {192.0, 216.0, 100.0}
# Column names in a table that has a separate row for each value of each measured quantity (tag).
_TAG = re.compile(
    r"^(?:tag|point|channel|sensor|signal|mnemonic|parameter|variable|metric|measurement|item|node|curve|topic|name|id|messstelle|kanal|canal|etiqueta|标签|测点|位号)"
    r"(?: ?(?:name|id|no|number|path))?$"
)
_VALUE = re.compile(
    r"^(?:data |process |raw |average |avg )?(?:value|values|val|reading|result|wert|valor|valeur|verdi|值|数值)$"
)
_UNIT = re.compile(r"^(?:unit|units|uom|eu|eng(?:ineering)? units?|einheit|unidad|unité|单位)$")
_MARKS = re.compile(r"[^\w./%]+|_")
_NUMBER = r"^[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?$"
_GROUPED = r"^[+-]?\d{1,3}(?:[.,'’   ]\d{3})+(?:[.,]\d*)?$"
_CLOCK = r"\d{1,2}:\d{2}(:\d{2}([.,:]\d*)?)?( ?[AaPp]\.?[Mm]\.?)?"
_DIGITS = r"\d{3,6}(\.\d*)?"  # a clock HHMMSS next to a date
_HIGHEST = 3.0e8  # pressure that no rig exceeds, Pa


_NUMBER_IN_NAME = r"(?<![\w,])(?<!\d\.)[+-]?\d+(?:,\d{3}(?!\d))*(?:[.,]\d+)?"
# A range such as "0-350 bar" or "0 bar to 350 bar", or only its upper end, "350 bar": two numbers and a unit.
_RANGE_IN_NAME = re.compile(
    rf"(?:({_NUMBER_IN_NAME})\s*[a-z]*\s*(?:-|\u2013|\u2026|\.{{2,3}}|~|\bto\b|\bbis\b)\s*)?"
    rf"({_NUMBER_IN_NAME})\s*([a-z][a-z0-9/²]*)",
    re.IGNORECASE,
)
_CURRENT = re.compile(r"\b4\s*(?:-|\u2013|to)\s*20\b|\bmA\b")


class GaugeSignal(NamedTuple):
    """
    Scale of a gauge that sends a current or a voltage.

    low, high: ends of its range in `unit`, "ma", "mv" or "v"; low_pa, high_pa: pressures at these ends, Pa, NaN if
    unknown.
    """

    low: float = 4.0
    high: float = 20.0
    unit: str = "ma"
    low_pa: float = math.nan
    high_pa: float = math.nan


def gauge_signal(name: str) -> GaugeSignal | None:
    """
    Return the scale that the name of a column states, such as "SPP 4-20 mA (0-350 bar)".

    Return None if the name states neither a range of a current or voltage nor "mA".
    """
    name = name.replace("_", " ")
    signal = GaugeSignal() if _CURRENT.search(name) else None
    low_pa = high_pa = math.nan
    for first, last, text in _RANGE_IN_NAME.findall(name):
        low, high, unit = _number_in_name(first or "0"), _number_in_name(last), _unit(text)
        if low < high and unit in _SIGNALS and first:
            signal = GaugeSignal(low, high, unit)
        elif low < high and unit in PRESSURES and unit not in _SIGNALS:
            low_pa, high_pa = low * PRESSURES[unit], high * PRESSURES[unit]
    return None if signal is None else signal._replace(low_pa=low_pa, high_pa=high_pa)


def _number_in_name(text: str) -> float:
    return float(re.sub(r",(?=\d{3}(?!\d))", "", text).replace(",", "."))


@dataclasses.dataclass(frozen=True)
class _Column:
    """One column: its place in a row, its name, and its unit ("" if it has none)."""

    number: int
    name: str
    unit: str


def columns_of(text: str) -> dict[str, str]:
    """
    Parse the columns that a user states, such as "time=Zeit,pressure_bar=SPP" or "time_s=1,pressure_bar=2".

    Returns the name or number of the column of each quantity, by quantity with unit.

    Raises
    ------
    ValueError
        A part has no "=", its quantity does not exist, or its decimal mark is not comma or point.
    """
    pairs = {}
    for part in filter(None, text.split(",")):
        quantity, equals, column = part.partition("=")
        quantity = quantity.strip().lower()
        if not equals or quantity.partition("_")[0] not in _SAID:
            raise ValueError(
                f"--columns {part}: write time=NAME, date=NAME or pressure_bar=NAME, where a number counts columns from"
                " 1; tag=NAME and value=NAME for rows of several tags, of which pressure_bar names one; rate_hz=50 for"
                " rows without times; decimal=comma or decimal=point"
            )
        pairs[quantity] = column.strip()
        if quantity.startswith("decimal"):
            if quantity != "decimal" or pairs[quantity].lower() not in _DECIMAL_MARKS:
                raise ValueError(
                    f"--columns {part}: the decimal mark is not known; write decimal=comma or decimal=point"
                )
            pairs[quantity] = pairs[quantity].lower()
    return pairs


def read_pressure(path: Path, gauge: int, columns: Mapping[str, str]) -> tuple[Array, Array, str, tuple[str, ...]]:
    """
    Return times, s, pressure, Pa, the meaning of time 0, and notes on faults of the table.

    Parameters
    ----------
    gauge : int
        Number of the pressure column among all pressure columns, from 1.
    columns : mapping of str
        Columns that the caller states; see `columns_of`.

    Raises
    ------
    ValueError
        There is no column of time or pressure, its unit is unknown, its decimal mark is ambiguous, or its cells are
        not times; or the rate that the caller states is not a number from 0 to 1 MHz.
    OSError
        The file cannot be read.
    """
    file = _TableFile(path, columns)
    column = file.pressure(gauge)
    times = file.times(column)
    quality = file.found("quality", _QUALITY)[:1]
    cells = file.cells([*times, column, *quality])
    pressure, notes = file.numbers(cells[len(times)], column)
    if file.is_cut(column):
        pressure[-1] = math.nan
        notes.append("the last line is not complete and is left out")
    if quality:
        pressure, said = _of_good_quality(pressure, cells[-1])
        notes = [*notes, *said]
    if times:
        time, origin, said = file.seconds(times, cells[: len(times)])
    else:
        time, origin, said = file.counted(len(pressure)), "first row of the file", []
    notes = [*said, *notes]
    rows, said = table_times.without_repeats(time, pressure)
    time, pressure, notes = time[rows], pressure[rows], [*notes, *said]
    time, rows, said = table_times.in_order(time)
    pressure, notes = pressure[rows], [*notes, *said]
    time, said = table_times.spread(time)
    notes += said
    if file.skipped:
        notes.append(f"{file.skipped} lines are not rows of this table, such as comments, and are left out")
    if file.tag:
        notes.append(f"the file has rows of several tags; only the rows of {file.tag!r} are read")
    values = pressure
    pressure, said = in_pascal(values, column.unit, column.name)
    notes += said
    if np.isfinite(pressure).sum() * 2 < np.isfinite(values).sum():
        raise ValueError(
            f"{path}: most values of the column {column.name!r} are not in the range of its signal (median"
            f" {np.nanmedian(values):.4g}); if they are pressures, name their unit, such as --columns"
            f" pressure_bar={column.name}"
        )
    if time.size and time[0] > 365.0 * 86_400.0:
        return time - time[0], pressure, f"first time of the file ({times[-1].name})", tuple(notes)
    return time, pressure, origin, tuple(notes)


def read_numbers(path: Path, columns: Mapping[str, str]) -> tuple[Array, Array]:
    """
    Return pump numbers and times, s, of a table of strokes; NaN for a cell without a number.

    Raises
    ------
    ValueError
        A column is missing, or the cells are not times.
    OSError
        The file cannot be read.
    """
    file = _TableFile(path, columns)
    pumps = file.found("pump", _PUMP)
    if not pumps:
        raise ValueError(file.missing("pump", "a column pump"))
    times = file.times(pumps[0])
    cells = file.cells([*times, pumps[0]])
    time, _, _ = file.seconds(times, cells[:-1])
    return file.numbers(cells[-1], pumps[0])[0], time


class LiveColumns(NamedTuple):
    """
    Places of time and pressure in a line, from 0, and their units; the unit of the time is "" if unknown.

    name: name of the column of pressure, "" if unknown; it may state the range of the gauge.
    """

    time: int | None
    time_unit: str
    pressure: int
    unit: str
    name: str = ""


def live_columns(names: Sequence[str], columns: Mapping[str, str]) -> LiveColumns | None:
    """
    Return the columns of lines that arrive one by one; None if neither the caller nor the names state them.

    Parameters
    ----------
    names : sequence of str
        Cells of a first line; empty until this line has arrived.
    columns : mapping of str
        See `columns_of`.

    Raises
    ------
    ValueError
        A unit is not known, or the number of a column is 0.
    """
    places: dict[str, tuple[int, str]] = {}
    words = [_words(name, "") for name in names]
    for quantity in ("time", "pressure"):
        said = next(((key, name) for key, name in columns.items() if key.partition("_")[0] == quantity), None)
        if said is not None:
            key, name = said
            unit = key.partition("_")[2]
            if unit not in (table_times.UNITS if quantity == "time" else PRESSURES) and (unit or quantity != "time"):
                raise ValueError(
                    f"--columns {key}={name}: the unit is not known; write for example pressure_bar={name}"
                )
            if name.isdecimal() and name not in names:
                if int(name) < 1:
                    raise ValueError(f"--columns {key}={name}: columns are counted from 1")
                places[quantity] = int(name) - 1, unit
            elif name in names:
                places[quantity] = list(names).index(name), unit
        elif not columns:
            fits = _TIME.match if quantity == "time" else lambda text: _STANDPIPE.search(text) or _PRESSURE.search(text)
            found = [(k, unit) for k, (text, unit) in enumerate(words) if fits(text)]
            places |= {quantity: found[0]} if found else {}
    place, unit = places.get("pressure", (-1, ""))
    if place < 0 or unit not in PRESSURES:
        return None
    time, time_unit = places.get("time", (None, ""))
    return LiveColumns(time, time_unit, place, unit, names[place] if place < len(names) else "")


def untagged(row: Mapping[str, str]) -> dict[str, str]:
    """Return a row; if it holds one value of one tag (tag, value, unit), the value gets a column named by the tag."""
    tag, value, unit = (
        next((name for name in row if pattern.match(_last(_words(name, "")[0]))), "")
        for pattern in (_TAG, _VALUE, _UNIT)
    )
    if not (tag and value):
        return dict(row)
    rest = {name: cell for name, cell in row.items() if name not in (tag, value, unit)}
    return {**rest, row[tag] + (f" [{row[unit]}]" if row.get(unit) else ""): row[value]}


class _TableFile:
    """File with a table, after its first lines were read: first row, separator of the cells, and columns."""

    def __init__(self, path: Path, columns: Mapping[str, str]) -> None:
        size = check_regular(path, budgets.PRESSURE)
        with path.open("rb") as file:
            start = file.read(_HEAD)
        self.path, self._said, self.skipped, self.tag = path, columns, 0, ""
        self._whole = is_spreadsheet(start)
        self._encoding = "utf-8" if self._whole else _encoding(start)
        self._las = False
        self._json: dict[str, list[str]] = {}
        self._kept: Any = None  # Arrow array of booleans that selects the rows of the tag; None: all rows
        if self._whole:
            self._table = table_of(read_file(path, budgets.SPREADSHEET), str(path), _is_header, _are_units)
        else:
            text = start.decode(self._encoding, errors="ignore")
            if size > len(start):
                text = text[: text.rfind("\n") + 1] or text
            self._las = is_las(text.lstrip("\ufeff"))
            if json_columns.is_json(text):
                self._json, self.skipped = json_columns.read(path, self._encoding)
                self._table = _head_of(self._json, str(path))
            else:
                self._table = las_table(text, str(path)) if self._las else _text_table(text, str(path))
        self.headless = any(looks_like_number(name) for name in self._table.names)
        if not self._table.rows and not self.headless:
            raise ValueError(f"{path} has column names but no row below them")

    def found(self, quantity: str, pattern: re.Pattern[str]) -> list[_Column]:
        """Return the columns of a quantity in order, or only the column that the caller names for the quantity."""
        named = self._by_caller(quantity)
        return [named] if named else [one for one, words in self._columns() if pattern.match(_last(words))]

    def pressure(self, gauge: int) -> _Column:
        """
        Return the column of pressure for a gauge, from 1, with its unit.

        Raises
        ------
        ValueError
            There is no such column, or its unit is unknown.
        """
        tagged = self._tagged(gauge)
        if tagged is not None:
            return self._with_unit(tagged)
        one = self._by_caller("pressure")
        found = [one] if one else _pressures(self._columns())
        if len(found) < gauge:
            what = f"a column of pressure for gauge {gauge}" if found else "a column of pressure"
            raise ValueError(self.missing("pressure", what))
        return self._with_unit(found[gauge - 1])

    def _with_unit(self, column: _Column) -> _Column:
        """Return a column of pressure with its unit; ValueError if it is unknown."""
        column = dataclasses.replace(column, unit=column.unit or self._unit_in_cells(column.number))
        if column.unit not in PRESSURES and self._kept is None:
            units = _nearest(column, [one for one, words in self._columns() if _UNIT.match(_last(words))])
            column = dataclasses.replace(column, unit=column.unit or next(iter(self._units_of(units[:1])), ""))
        if column.unit not in PRESSURES:
            raise ValueError(
                f"{self.path}: pressure (column {column.name!r}) has no unit of pressure; write pressure_bar or a line"
                f" of units, or set it with --columns pressure_bar={column.name}; units:"
                f" {', '.join((*_UNITS, 'v', 'mv', 'ma'))}"
            )
        return column

    def _tagged(self, gauge: int) -> _Column | None:
        """
        Return the column of values, named as the tag of the pressure, and keep only the rows of this tag.

        Return None if the rows of the table are not values of tags. The tag is named by the caller, or is the
        pressure of the given gauge, from 1, by the names and units of all tags.

        Raises ValueError if no tag is a pressure.
        """
        import pyarrow.compute as pc

        tags, values = self.found("tag", _TAG)[:1], self.found("value", _VALUE)[:1]
        named = any(_STANDPIPE.search(words) or _PRESSURE.search(words) for _, words in self._columns())
        if not (tags and values) or (named and self._by_caller("tag") is None):
            return None
        units = [one for one, words in self._columns() if _UNIT.match(_last(words))][:1]
        wanted = [*tags, *units]
        text = [pc.utf8_trim_whitespace(pc.cast(one, "string")) for one in self.cells(wanted)]
        names = [name for name in pc.unique(text[0]).to_pylist() if name]
        budgets.PRESSURE.check("columns", len(names))
        rows = []
        for name in names:
            words, unit = _words(name, "")
            own = text[1].filter(pc.equal(text[0], name)) if units else None
            unit = unit or (next(iter(_all_units(own)), "") if own is not None else "") or values[0].unit
            rows.append((_Column(values[0].number, name, unit), words))
        said = next(((key, name) for key, name in self._said.items() if key.startswith("pressure")), None)
        found = _pressures(rows) if said is None else [one for one, _ in rows if one.name.lower() == said[1].lower()]
        if len(found) < gauge:
            raise ValueError(
                f"{self.path}: no tag is {said[1] if said else 'the pressure'}; the tags are {first_of(names)};"
                " name it with --columns pressure_bar=NAME"
            )
        column = found[0 if said else gauge - 1]
        if len(names) > 1:
            self._kept, self.tag = pc.equal(text[0], column.name), column.name
        return dataclasses.replace(column, unit=(said[0].partition("_")[2] if said else "") or column.unit)

    def _units_of(self, columns: Sequence[_Column]) -> set[str]:
        """Return the units that columns of units contain in the first rows of the file."""
        return {_unit(str(cell)) for one in columns for cell in self._cells_of(one.number)} - {""}

    def _columns(self) -> list[tuple[_Column, str]]:
        """Return the columns with the words of their names; an empty list if no line names the columns."""
        if self.headless:
            return []
        table = self._table
        units = [*table.units, *[""] * len(table.names)]
        rows = [(k, name, *_words(name, units[k])) for k, name in enumerate(table.names)]
        return [(_Column(k, name, unit), words) for k, name, words, unit in rows]

    def _by_caller(self, quantity: str) -> _Column | None:
        for key, name in self._said.items():
            if key.partition("_")[0] == quantity:
                return self._named(name, key.partition("_")[2])
        return None

    def _named(self, name: str, unit: str) -> _Column:
        """Return the column with this name, or with this number from 1; ValueError if there is none."""
        names = [one.strip().lower() for one in self._table.names]
        if name.lower() in names and not self.headless:
            k = names.index(name.lower())
            own = _words(self._table.names[k], self._table.units[k])[1]
            return _Column(k, self._table.names[k], unit or own)
        if name.isdecimal() and 1 <= int(name) <= len(names):
            k = int(name) - 1
            return _Column(k, name if self.headless else self._table.names[k], unit)
        raise ValueError(f"--columns {name}: {self.path} has no such column; it has {', '.join(self._table.names)}")

    def missing(self, quantity: str, what: str) -> str:
        """Return the message for a missing column, with the options that name it."""
        if self.headless:
            return f"{self.path}: no line names the columns; name them with --columns time_s=1,pressure_bar=2"
        return (
            f"{self.path}: there is not {what}; the columns are {first_of(self._table.names)}; name them as in"
            f" time_s,pressure_bar, or name the column with --columns {quantity}=NAME"
        )

    def times(self, value: _Column) -> list[_Column]:
        """
        Return the columns of the time: [time], or [date, time] if the date is a separate column.

        Return an empty list if the caller states a rate. If several time columns have the same name, or are named
        after a quantity ("pressure time"), the last one before the column `value` is used. Raises ValueError if there
        is no column of time.
        """
        if any(key.startswith("rate") for key in self._said):
            return []
        dates = self.found("date", _DATE)
        # A date may contain the time of day, as a clock or as the fraction of a day.
        clocks = self.found("time", _TIME) or [
            one for one in dates if ":" in self._first(one) or looks_like_number(self._first(one))
        ]
        own = [one for one, words in self._columns() if words.endswith((" time", " timestamp", " time stamp"))]
        alike = not clocks or len({_last(_words(one.name, "")[0]) for one in clocks}) == 1
        # A column whose name has both quantities ("time_s-pressure_pa") is not read as both.
        clocks = [one for one in clocks or own if one.number != value.number]
        if not clocks:
            raise ValueError(self.missing("time", "a column of time (or set --columns rate_hz=50)"))
        if alike:
            clocks = [one for one in clocks if one.number < value.number][-1:] or clocks
        clock = dataclasses.replace(clocks[0], unit=clocks[0].unit or self._unit_in_cells(clocks[0].number))
        dates = [one for one in dates if one.number != clock.number]
        # A separate date is not needed if the times contain the date or are numbers of seconds.
        form = _CLOCK if ":" in self._first(clock) or clock.unit in table_times.UNITS else _DIGITS
        return [*dates[:1], clock] if re.fullmatch(form, self._first(clock).strip()) else [clock]

    def counted(self, count: int) -> Array:
        """Return the times, s, of `count` rows at the rate that the caller states; ValueError if it is not usable."""
        text = next(value for key, value in self._said.items() if key.startswith("rate"))
        try:
            rate = float(text)
        except ValueError:
            rate = math.nan
        if not 0.0 < rate < 1e6:
            raise ValueError(f"--columns rate_hz={text}: write the rows a second, such as rate_hz=50")
        return np.arange(count) / rate

    def _cells_of(self, number: int) -> list[Any]:
        return [row.cells[number] for row in self._table.rows[:200] if number < len(row.cells)]

    def _first(self, column: _Column) -> str:
        return next((str(cell) for cell in self._cells_of(column.number)), "")

    def _unit_in_cells(self, number: int) -> str:
        """Return the unit that follows the numbers of a column, such as "203.4 bar"; "" if there is none."""
        found = (split(cell) for cell in self._cells_of(number))
        units = {_unit(one[1]) for one in found if one is not None}
        return units.pop() if len(units) == 1 else ""

    def cells(self, wanted: Sequence[_Column]) -> list[Any]:
        """Return the cells of columns as Arrow arrays of numbers or text; if a tag was selected, only its rows."""
        cells = self._all_cells(wanted)
        return cells if self._kept is None else [one.filter(self._kept) for one in cells]

    def is_cut(self, column: _Column) -> bool:
        """
        Return whether the last line of a text file is cut off.

        The line is cut off if it has no line end, and its cell in the column is shorter than those in the first rows.
        """
        if self._whole or self._las or self._json or self._kept is not None:
            return False
        with self.path.open("rb") as file:
            file.seek(max(0, self.path.stat().st_size // 2 * 2 - 4096))
            text = file.read().decode(self._encoding.replace("-sig", ""), errors="replace")
        last = re.split(r"[\r\n]", text)[-1]
        cells = last.split() if self._table.separator.startswith(" ") else last.split(self._table.separator or None)
        if len(cells) <= column.number:
            return False
        usual = [len(str(cell)) for cell in self._cells_of(column.number)]
        return len(cells[column.number].strip(' "')) < min(usual, default=0)

    def _all_cells(self, wanted: Sequence[_Column]) -> list[Any]:
        """
        Return the cells of columns, as `cells`, in all rows, even if only the rows of one tag are selected.

        Raises ValueError if the file cannot be read as a table.
        """
        import pyarrow as pa

        numbers = [one.number for one in wanted]
        if self._json:
            columns = list(self._json.values())
            return [pa.chunked_array([pa.array(columns[number], pa.string())]) for number in numbers]
        separator = self._table.separator
        if self._whole or self._las or separator.startswith(" ") or not separator:
            columns = self._table_cells(numbers) if self._whole else self._split(numbers)
            return [pa.chunked_array([pa.array(column, pa.string())]) for column in columns]
        width = max((len(row.cells) for row in self._table.rows[:50]), default=len(self._table.names))
        width = max(width, *(number + 1 for number in numbers))
        kinds = [pa.float64() if self._is_plain(number) else pa.string() for number in numbers]
        for types in (kinds, [pa.string()] * len(kinds)):
            try:
                return self._read(types, [str(number) for number in numbers], [str(k) for k in range(width)])
            except pa.ArrowInvalid as error:
                # Read the columns again as text, because a cell is not a number.
                if pa.float64() not in types:
                    raise ValueError(f"{self.path}: cannot be read as a table: {error}") from error
        raise AssertionError

    def _is_plain(self, number: int) -> bool:
        """Return whether Arrow reads the cells of a column as numbers."""
        return all(re.match(_NUMBER, str(cell)) for cell in self._cells_of(number)[:50])

    def _read(self, types: Sequence[Any], wanted: list[str], names: list[str]) -> list[Any]:
        """
        Return the columns with these names and types; `skipped` becomes the number of lines that are not rows.

        Raises pyarrow.ArrowInvalid if a cell is not of its type, ValueError if there are too many rows.
        """
        from pyarrow import csv

        skipped: list[int] = []

        def skip(row: Any) -> str:
            # Arrow gives the row number only when it reads with one thread, so count the rows here.
            skipped.append(row.actual_columns)
            return "skip"

        with self.path.open("rb") as file:
            table = csv.read_csv(
                file,
                csv.ReadOptions(
                    skip_rows=0 if self.headless else _line(self._table), column_names=names, encoding=self._encoding
                ),
                csv.ParseOptions(delimiter=self._table.separator, invalid_row_handler=skip),
                csv.ConvertOptions(
                    column_types=dict(zip(wanted, types, strict=True)),
                    include_columns=wanted,
                    strings_can_be_null=False,
                ),
            )
        self.skipped = len(skipped)
        try:
            budgets.PRESSURE.check("records", table.num_rows)
        except BudgetError as error:
            raise ValueError(f"{self.path}: {error}") from error
        return [table.column(name) for name in wanted]

    def _split(self, numbers: Sequence[int]) -> list[list[str]]:
        """
        Return the cells of columns separated by spaces; of a LAS file, the cells of the section ~A.

        Comments, and lines with too few cells, are left out.
        """
        columns: list[list[str]] = [[] for _ in numbers]
        first = 0 if self.headless or self._las else _line(self._table)
        inside = not self._las
        with io.TextIOWrapper(self.path.open("rb"), encoding=self._encoding, errors="replace") as file:
            for k, line in enumerate(file):
                if self._las and line.startswith("~"):
                    inside = line[1:2] in "Aa"
                    continue
                cells = line.split()
                if (
                    inside
                    and k >= first
                    and len(cells) > max(numbers)
                    and not line.lstrip().startswith(("#", "!", "%"))
                ):
                    for column, number in zip(columns, numbers, strict=True):
                        column.append(cells[number])
        return columns

    def _table_cells(self, numbers: Sequence[int]) -> list[list[str]]:
        """Return columns of a spreadsheet as lists of texts; rows that are too short are left out."""
        rows = [row.cells for row in self._table.rows if len(row.cells) > max(numbers)]
        return [[repr(row[k]) if isinstance(row[k], float) else str(row[k]) for row in rows] for k in numbers]

    def numbers(self, cells: Any, column: _Column) -> tuple[Array, list[str]]:
        """
        Return the numbers of a column, NaN for a cell without a number or with a null value, and notes on such cells.

        Raises
        ------
        ValueError
            The decimal mark is ambiguous: 203,812 may be 203.812 or 203 812.
        """
        import pyarrow as pa
        import pyarrow.compute as pc

        if pa.types.is_floating(cells.type):
            return _without_nulls(moments.array(cells))
        text = pc.utf8_trim_whitespace(cells)
        if column.unit:
            text = pc.replace_substring_regex(text, rf"(?i)\s*(?:{column.unit}|kg/cm2|kg/cm²)\.?$", "")
        mark = self._mark(text, column)
        grouped = pc.match_substring_regex(text, _GROUPED)
        bare = pc.replace_substring_regex(text, rf"['’   {'.' if mark == ',' else ','}]", "")
        text = pc.if_else(grouped, bare, text)
        if mark == ",":
            # A point that is left in a cell is not a decimal mark of this column.
            text = pc.replace_substring(pc.replace_substring(text, ".", "?"), ",", ".")
        is_number = pc.match_substring_regex(text, _NUMBER)
        kept = pc.if_else(is_number, text, pa.scalar(None, pa.string()))
        values, notes = _without_nulls(moments.array(pc.cast(kept, pa.float64())))
        words = pc.and_(pc.invert(is_number), pc.greater(pc.utf8_length(text), 0))
        if count := pc.sum(words).as_py():
            example = cells.filter(words)[0].as_py()[:20]
            notes.append(f"{count} cells have a word in place of a number, such as {example!r}, and count as missing")
        return values, notes

    def _mark(self, text: Any, column: _Column) -> str:
        """Return the decimal mark of a column of text, as `mark_of`; ValueError if the mark is ambiguous."""
        every = max(1, len(text) // 5000)
        others = (cell for row in self._table.rows[:200] for cell in row.cells)
        try:
            return mark_of(text[::every].to_pylist(), others, column.unit, self._said.get("decimal", ""))
        except ValueError as error:
            raise ValueError(f"{self.path}: column {column.name!r}: {error}") from error

    def seconds(self, columns: Sequence[_Column], cells: Sequence[Any]) -> tuple[Array, str, list[str]]:
        """
        Return the times, s, of a column of times or of columns with date and clock, the meaning of time 0, and notes.

        Raises
        ------
        ValueError
            The cells are not times, or their unit is not known.
        """
        import pyarrow.compute as pc

        column, text = columns[-1], cells[-1]
        if len(columns) > 1:
            text = pc.utf8_trim_whitespace(pc.cast(text, "string"))
            text = text if ":" in self._first(column) else table_times.clock_text(text)
            if text is not None:
                date = pc.utf8_trim_whitespace(pc.cast(cells[0], "string"))
                text = pc.binary_join_element_wise(date, text, " ")
        elif ":" not in self._first(column):
            numbers, notes = self.numbers(text, column)
            # If most cells are numbers, a cell with a word is a missing sample.
            if np.isfinite(numbers).sum() * 2 > len(numbers):
                return self._of_numbers(numbers, column), f"{column.name} of the file", notes
        if text is None:
            numbers, notes = self.numbers(cells[-1], column)
            return self._of_numbers(numbers, column), f"{column.name} of the file", notes
        text = pc.utf8_trim_whitespace(pc.cast(text, "string"))
        seconds = moments.of_text(text)
        if not np.isfinite(seconds).sum() * 2 > len(seconds):
            example = text[0].as_py() if len(text) else ""
            raise ValueError(
                f"{self.path}: {column.name}: {example!r} is not a time; expected seconds, 2026-03-01T12:00:00.020 or"
                " 12:00:00.02"
            )
        return seconds, f"{column.name} of the file", []

    def _of_numbers(self, numbers: Array, column: _Column) -> Array:
        try:
            return table_times.of_numbers(numbers, column.unit)
        except table_times.UnknownUnitError as error:
            raise ValueError(
                f"{self.path}: time (column {column.name!r}) has no unit and {error}; set it with --columns"
                f" time_ms={column.name} or time_s={column.name}"
            ) from error


def mark_of(cells: Iterable[str], others: Iterable[Cell], unit: str, said: str) -> str:
    """
    Return the decimal mark of a column of text.

    It is the mark that the caller states, else the mark in the numbers of the column or of the table, else the only
    mark with which no pressure is impossibly high.

    Parameters
    ----------
    cells, others : iterable of str
        Cells of the column, and of the whole table.
    unit : str
        Unit of the column.
    said : str
        "comma" or "point" as the caller states; "" if not stated.

    Raises
    ------
    ValueError
        The decimal mark is ambiguous: 203,812 may be 203.812 or 203 812.
    """
    if said:
        return _DECIMAL_MARKS[said]
    own = [one[0] for cell in cells if (one := split(cell)) is not None]
    votes = [decimal_mark(number) for number in own]
    if any(votes):
        return max(",.", key=votes.count)
    grouped = next((number for number in own if re.match(_GROUPED, number)), "")
    if not grouped:
        return "."
    seen = [decimal_mark(one[0]) for cell in others if (one := split(cell)) is not None]
    if any(seen):
        return max(",.", key=seen.count)
    # Largest pressure if the mark separates thousands.
    size = max(float(re.sub(r"\D", "", number) or 0.0) for number in own) * PRESSURES.get(unit, 1.0)
    if size > _HIGHEST:
        return "," if "," in grouped else "."
    raise ValueError(
        f"{grouped} may be {grouped.replace(',', '.')} or {re.sub(r'[.,]', '', grouped)}; add decimal=comma or"
        " decimal=point to --columns"
    )


def in_pascal(values: Array, unit: str, name: str = "") -> tuple[Array, list[str]]:
    """
    Return pressures, Pa, of numbers in a unit of `PRESSURES`, and notes; NaN where there is no pressure.

    A current or a voltage is scaled by the range of the gauge that the name states (`gauge_signal`). Without a range, a
    current is scaled by a usual one (`_FULL_SCALE`), and a voltage is returned in V instead of Pa.
    """
    signal = gauge_signal(name)
    if signal is None or signal.unit != unit:
        signal = GaugeSignal(unit=unit)
    if unit == "ma" or math.isfinite(signal.low_pa):
        return _of_signal(values, signal)
    with np.errstate(over="ignore"):
        pressure = values * PRESSURES[unit]
    return np.where(np.isfinite(pressure), pressure, math.nan), []


def _line(table: Table) -> int:
    """Return the number of lines of the file above the first row of its table; 0 if unknown."""
    found = re.search(r"line (\d+)$", table.rows[0].at if table.rows else table.at)
    return int(found[1]) - 1 if found else 0


def _encoding(start: bytes) -> str:
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    for encoding, zeros in (("utf-16-le", start[1:200:2]), ("utf-16-be", start[0:200:2])):
        if len(zeros) > 4 and zeros.count(0) > 0.8 * len(zeros):
            return encoding
    try:
        start[:-4].decode("utf-8")
    except UnicodeDecodeError:
        chinese = start.decode("gb18030", errors="ignore")
        return "gb18030" if re.search("时间|压|泵", chinese) else "latin-1"
    return "utf-8-sig" if start.startswith(b"\xef\xbb\xbf") else "utf-8"


def _text_table(text: str, path: str) -> Table:
    """Return the table of a text; if no names were found, lines of titles above the names are left out."""
    table = table_of(text.encode(), path, _is_header, _are_units)
    if not _is_header(table.names):
        lines = text.splitlines()
        for k, line in enumerate(lines[:_TITLES]):
            if any(_is_header(line.split(separator)) for separator in ",;\t|"):
                # Replace the titles by empty lines, so that the line numbers do not change.
                return table_of(("\n" * k + "\n".join(lines[k:])).encode(), path, _is_header, _are_units)
    return table


def _head_of(columns: Mapping[str, list[str]], path: str) -> Table:
    """Return the first rows of columns as a table."""
    first = [column[:200] for column in columns.values()]
    rows = tuple(Row(f"{path}, sample {k + 1}", cells) for k, cells in enumerate(zip(*first, strict=True)))
    return Table(path, path, tuple(columns), ("",) * len(columns), rows)


def _pressures(columns: Sequence[tuple[_Column, str]]) -> list[_Column]:
    """
    Return the pressure columns, standpipe pressure first and averages last, which have no pulses.

    columns: columns with the words of their names. If no name means a pressure, all columns with a unit of pressure
    are returned.
    """
    rows = [(one, words) for one, words in columns if not _ELSEWHERE.search(words)]
    rows.sort(key=lambda row: bool(_AVERAGED.search(row[1])))
    named = [one for one, words in rows if _STANDPIPE.search(words)]
    named += [one for one, words in rows if one not in named and _PRESSURE.search(words)]
    if named:
        # If some columns have a unit of pressure, columns without it are flags or counters.
        return [one for one in named if one.unit in PRESSURES] or named
    return [one for one, _ in rows if one.unit in PRESSURES]


def _last(words: str) -> str:
    """Return the part of a name after its last dot; dots join the names of nested objects."""
    return words.rpartition(".")[2]


def _nearest(column: _Column, others: Sequence[_Column]) -> list[_Column]:
    """Return the other columns, sorted so that columns of the same object as `column` come first."""
    above = column.name.rpartition(".")[0]
    return sorted(others, key=lambda one: one.name.rpartition(".")[0] != above)


def _all_units(cells: Any) -> set[str]:
    """Return the units in an Arrow array of text."""
    return {_unit(text or "") for text in cells.unique().to_pylist()} - {""}


def _words(name: str, unit: str) -> tuple[str, str]:
    """Return the words of a name in lower case without its unit, and the unit ("" if there is none)."""
    brackets = re.findall(r"[(\[{]([^)\]}]*)[)\]}]?", name)
    words = " ".join(_MARKS.sub(" ", re.sub(r"[(\[{][^)\]}]*[)\]}]?", " ", name)).lower().split())
    own = [_unit(one) for one in (unit, *brackets) if _unit(one)]
    if (signal := gauge_signal(name)) is not None:
        # A unit of pressure next to that of the signal belongs to the range of the gauge.
        own = [signal.unit]
    # The unit may be the last word, or follow the name and a dot as in LAS.
    first, _, last = words.replace(".", " ").rpartition(" ")
    if not own and first and (last in table_times.UNITS or last in PRESSURES):
        own, words = [last], words[: len(first)]
    return words, own[0] if own else ""


def _unit(text: str) -> str:
    word = "".join(c for c in text.lower() if c.isalpha())
    return word if word in table_times.UNITS or word in PRESSURES else ""


def _is_header(names: Sequence[str]) -> int:
    found = [_words(str(name), "") for name in names]
    tagged = all(any(pattern.match(words) for words, _ in found) for pattern in (_TAG, _VALUE))
    times = [any(pattern.match(words) for pattern in (_TIME, _DATE, _PUMP)) for words, _ in found]
    pressures = [
        bool(_STANDPIPE.search(words) or _PRESSURE.search(words) or unit in PRESSURES) for words, unit in found
    ]
    quantities = sum(times) + (tagged or any(p and not t for p, t in zip(pressures, times, strict=True)))
    return quantities if quantities > 1 and not any(looks_like_number(name) for name in names) else 0


def _are_units(cells: Sequence[str]) -> int:
    words = [str(cell).strip("()[] ") for cell in cells]
    return int(any(_unit(word) for word in words) and not any(looks_like_number(word) for word in words))


def _without_nulls(values: Array) -> tuple[Array, list[str]]:
    """Return numbers with NaN in place of null values, and a note on their count (a list; empty without nulls)."""
    null = np.isin(values, NULL_NUMBERS)
    if not null.any():
        return values, []
    note = f"{int(null.sum())} cells have the null value {values[null][0]:g} and count as missing"
    return np.where(null, math.nan, values), [note]


def _of_good_quality(pressure: Array, quality: Any) -> tuple[Array, list[str]]:
    """Return pressure with NaN where the quality column is bad, as a word or an OPC number, and notes."""
    import pyarrow.compute as pc

    text = pc.utf8_lower(pc.utf8_trim_whitespace(pc.cast(quality, "string")))
    bad = pc.match_substring_regex(text, "^(?:bad|invalid|fail|error|fault|not )")
    lost = moments.array(pc.cast(pc.cast(bad, "int8"), "float64")) == 1.0
    is_number = pc.match_substring_regex(text, _NUMBER)
    numbers = moments.array(pc.cast(pc.if_else(is_number, text, None), "float64"))
    if set(np.unique(numbers)) & _GOOD_QUALITIES:
        lost |= numbers < _BAD_QUALITY
    lost &= np.isfinite(pressure)
    note = f"{int(lost.sum())} samples have a bad quality and count as missing"
    return np.where(lost, math.nan, pressure), [note] if lost.any() else []


def _of_signal(values: Array, signal: GaugeSignal) -> tuple[Array, list[str]]:
    """Return the pressure, Pa, of signals in the unit of the scale, and notes; NaN where the gauge has failed."""
    unit = {"v": "V", "mv": "mV", "ma": "mA"}[signal.unit]
    said = f"a signal of {signal.low:g} to {signal.high:g} {unit}"
    if math.isnan(signal.low_pa):
        signal = signal._replace(low_pa=0.0, high_pa=_FULL_SCALE)
        note = (
            f"{said}: the range of the gauge is not known, {_FULL_SCALE / 1e5:g} bar is assumed at {signal.high:g}"
            f' {unit}; write the range into the name of the column, such as "SPP 4-20 mA (0-350 bar)"'
        )
    else:
        note = f"{said} is read as {signal.low_pa / 1e5:.6g} to {signal.high_pa / 1e5:.6g} bar, as the column is named"
    notes = [note]
    low, high = _FAILED_LOW * signal.low, _FAILED_HIGH * signal.high
    broken = (values < low) & (signal.low > 0.0)
    failed = broken | (values > high)
    if broken.any():
        notes.append(
            f"{int(broken.sum())} samples are below {low:.3g} {unit}, which means a broken wire, and count as missing"
        )
    if (values > high).any():
        notes.append(
            f"{int((values > high).sum())} samples are above {high:.3g} {unit}, which means a failed gauge, and count"
            " as missing"
        )
    share = (values - signal.low) / (signal.high - signal.low)
    return np.where(failed, math.nan, signal.low_pa + share * (signal.high_pa - signal.low_pa)), notes
