# SPDX-License-Identifier: Apache-2.0
"""
Time and pressure in a table as a rig writes it: text, LAS, spreadsheet or JSON, of any usual kind.

The table layer of the lists finds encoding, separator, names and units in the first lines, and `pressure_columns` the
quantities; the rows, which may be many millions, are read by Arrow. A cell that is not a number is a missing sample and
is counted. A historian writes a row for each value of each of its tags (time, tag, value, quality); the rows of the tag
of the pressure are the samples.
"""

from __future__ import annotations

import dataclasses
import io
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mwd_sensors.core import budgets
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.budgets import BudgetError
from mwd_sensors.core.foreign_text import first_of
from mwd_sensors.core.input_files import check_regular, read_file
from mwd_surface.list_files import moments
from mwd_surface.list_files.exchange_formats import is_las, las_table
from mwd_surface.list_files.grid_file import Row, is_spreadsheet
from mwd_surface.list_files.number_cells import NULL_NUMBERS, looks_like_number, split
from mwd_surface.list_files.table import Table, encoding_of, table_of
from mwd_surface.receiver import json_columns, table_times
from mwd_surface.receiver.gauge_scale import PRESSURES, UNITS, in_pascal
from mwd_surface.receiver.pressure_columns import (
    DATE,
    GROUPED,
    PUMP,
    QUALITY,
    TAG,
    TIME,
    UNIT,
    VALUE,
    NamedColumn,
    are_units,
    is_header,
    last_part,
    mark_of,
    means_pressure,
    pressures_of,
    unit_of,
    words_of,
)

_TITLES = 100  # lines of titles above the names
_HEAD = 20_000  # bytes in which names, units and the first rows stand
_BAD_QUALITY = 64  # lowest quality of a good sample, for OPC quality numbers and for percent
_GOOD_QUALITIES = {192.0, 216.0, 100.0}
_NUMBER = r"^[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?$"
_CLOCK = r"\d{1,2}:\d{2}(:\d{2}([.,:]\d*)?)?( ?[AaPp]\.?[Mm]\.?)?"
_DIGITS = r"\d{3,6}(\.\d*)?"  # a clock HHMMSS next to a date


def read_pressure(path: Path, gauge: int, columns: Mapping[str, str]) -> tuple[Array, Array, str, tuple[str, ...]]:
    """
    Return times, s, pressure, Pa, the meaning of time 0, and notes on faults of the table.

    Parameters
    ----------
    gauge : int
        Number of the pressure column among all pressure columns, from 1.
    columns : mapping of str
        Columns that the caller states; see `pressure_columns.columns_of`.

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
    quality = file.found("quality", QUALITY)[:1]
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
    pumps = file.found("pump", PUMP)
    if not pumps:
        raise ValueError(file.missing("pump", "a column pump"))
    times = file.times(pumps[0])
    cells = file.cells([*times, pumps[0]])
    time, _, _ = file.seconds(times, cells[:-1])
    return file.numbers(cells[-1], pumps[0])[0], time


class _TableFile:
    """File with a table, after its first lines were read: first row, separator of the cells, and columns."""

    def __init__(self, path: Path, columns: Mapping[str, str]) -> None:
        size = check_regular(path, budgets.PRESSURE)
        with path.open("rb") as file:
            start = file.read(_HEAD)
        self.path, self._said, self.skipped, self.tag = path, columns, 0, ""
        self._whole = is_spreadsheet(start)
        self._encoding = "utf-8" if self._whole else encoding_of(start, cut=size > len(start))
        self._las = False
        self._json: dict[str, list[str]] = {}
        self._kept: Any = None  # Arrow array of booleans that selects the rows of the tag; None: all rows
        if self._whole:
            self._table = table_of(read_file(path, budgets.SPREADSHEET), str(path), is_header, are_units)
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

    def found(self, quantity: str, pattern: re.Pattern[str]) -> list[NamedColumn]:
        """Return the columns of a quantity in order, or only the column that the caller names for the quantity."""
        named = self._by_caller(quantity)
        return [named] if named else [one for one, words in self._columns() if pattern.match(last_part(words))]

    def pressure(self, gauge: int) -> NamedColumn:
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
        found = [one] if one else pressures_of(self._columns())
        if len(found) < gauge:
            what = f"a column of pressure for gauge {gauge}" if found else "a column of pressure"
            raise ValueError(self.missing("pressure", what))
        return self._with_unit(found[gauge - 1])

    def _with_unit(self, column: NamedColumn) -> NamedColumn:
        """Return a column of pressure with its unit; ValueError if it is unknown."""
        column = dataclasses.replace(column, unit=column.unit or self._unit_in_cells(column.number))
        if column.unit not in PRESSURES and self._kept is None:
            units = _nearest(column, [one for one, words in self._columns() if UNIT.match(last_part(words))])
            column = dataclasses.replace(column, unit=column.unit or next(iter(self._units_of(units[:1])), ""))
        if column.unit not in PRESSURES:
            raise ValueError(
                f"{self.path}: pressure (column {column.name!r}) has no unit of pressure; write pressure_bar or a line"
                f" of units, or set it with --columns pressure_bar={column.name}; units:"
                f" {', '.join(UNITS)}"
            )
        return column

    def _tagged(self, gauge: int) -> NamedColumn | None:
        """
        Return the column of values, named as the tag of the pressure, and keep only the rows of this tag.

        Return None if the rows of the table are not values of tags. The tag is named by the caller, or is the
        pressure of the given gauge, from 1, by the names and units of all tags.

        Raises ValueError if no tag is a pressure.
        """
        import pyarrow.compute as pc

        tags, values = self.found("tag", TAG)[:1], self.found("value", VALUE)[:1]
        named = any(means_pressure(words) for _, words in self._columns())
        if not (tags and values) or (named and self._by_caller("tag") is None):
            return None
        units = [one for one, words in self._columns() if UNIT.match(last_part(words))][:1]
        wanted = [*tags, *units]
        text = [pc.utf8_trim_whitespace(pc.cast(one, "string")) for one in self.cells(wanted)]
        names = [name for name in pc.unique(text[0]).to_pylist() if name]
        budgets.PRESSURE.check("columns", len(names))
        rows = []
        for name in names:
            words, unit = words_of(name, "")
            own = text[1].filter(pc.equal(text[0], name)) if units else None
            unit = unit or (next(iter(_all_units(own)), "") if own is not None else "") or values[0].unit
            rows.append((NamedColumn(values[0].number, name, unit), words))
        said = next(((key, name) for key, name in self._said.items() if key.startswith("pressure")), None)
        found = pressures_of(rows) if said is None else [one for one, _ in rows if one.name.lower() == said[1].lower()]
        if len(found) < gauge:
            raise ValueError(
                f"{self.path}: no tag is {said[1] if said else 'the pressure'}; the tags are {first_of(names)};"
                " name it with --columns pressure_bar=NAME"
            )
        column = found[0 if said else gauge - 1]
        if len(names) > 1:
            self._kept, self.tag = pc.equal(text[0], column.name), column.name
        return dataclasses.replace(column, unit=(said[0].partition("_")[2] if said else "") or column.unit)

    def _units_of(self, columns: Sequence[NamedColumn]) -> set[str]:
        """Return the units that columns of units contain in the first rows of the file."""
        return {unit_of(str(cell)) for one in columns for cell in self._cells_of(one.number)} - {""}

    def _columns(self) -> list[tuple[NamedColumn, str]]:
        """Return the columns with the words of their names; an empty list if no line names the columns."""
        if self.headless:
            return []
        table = self._table
        units = [*table.units, *[""] * len(table.names)]
        rows = [(k, name, *words_of(name, units[k])) for k, name in enumerate(table.names)]
        return [(NamedColumn(k, name, unit), words) for k, name, words, unit in rows]

    def _by_caller(self, quantity: str) -> NamedColumn | None:
        for key, name in self._said.items():
            if key.partition("_")[0] == quantity:
                return self._named(name, key.partition("_")[2])
        return None

    def _named(self, name: str, unit: str) -> NamedColumn:
        """Return the column with this name, or with this number from 1; ValueError if there is none."""
        names = [one.strip().lower() for one in self._table.names]
        if name.lower() in names and not self.headless:
            k = names.index(name.lower())
            own = words_of(self._table.names[k], self._table.units[k])[1]
            return NamedColumn(k, self._table.names[k], unit or own)
        if name.isdecimal() and 1 <= int(name) <= len(names):
            k = int(name) - 1
            return NamedColumn(k, name if self.headless else self._table.names[k], unit)
        raise ValueError(f"--columns {name}: {self.path} has no such column; it has {', '.join(self._table.names)}")

    def missing(self, quantity: str, what: str) -> str:
        """Return the message for a missing column, with the options that name it."""
        if self.headless:
            return f"{self.path}: no line names the columns; name them with --columns time_s=1,pressure_bar=2"
        return (
            f"{self.path}: there is not {what}; the columns are {first_of(self._table.names)}; name them as in"
            f" time_s,pressure_bar, or name the column with --columns {quantity}=NAME"
        )

    def times(self, value: NamedColumn) -> list[NamedColumn]:
        """
        Return the columns of the time: [time], or [date, time] if the date is a separate column.

        Return an empty list if the caller states a rate. If several time columns have the same name, or are named
        after a quantity ("pressure time"), the last one before the column `value` is used. Raises ValueError if there
        is no column of time.
        """
        if any(key.startswith("rate") for key in self._said):
            return []
        dates = self.found("date", DATE)
        # A date may contain the time of day, as a clock or as the fraction of a day.
        clocks = self.found("time", TIME) or [
            one for one in dates if ":" in self._first(one) or looks_like_number(self._first(one))
        ]
        own = [one for one, words in self._columns() if words.endswith((" time", " timestamp", " time stamp"))]
        alike = not clocks or len({last_part(words_of(one.name, "")[0]) for one in clocks}) == 1
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

    def _first(self, column: NamedColumn) -> str:
        return next((str(cell) for cell in self._cells_of(column.number)), "")

    def _unit_in_cells(self, number: int) -> str:
        """Return the unit that follows the numbers of a column, such as "203.4 bar"; "" if there is none."""
        found = (split(cell) for cell in self._cells_of(number))
        units = {unit_of(one[1]) for one in found if one is not None}
        return units.pop() if len(units) == 1 else ""

    def cells(self, wanted: Sequence[NamedColumn]) -> list[Any]:
        """Return the cells of columns as Arrow arrays of numbers or text; if a tag was selected, only its rows."""
        cells = self._all_cells(wanted)
        return cells if self._kept is None else [one.filter(self._kept) for one in cells]

    def is_cut(self, column: NamedColumn) -> bool:
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

    def _all_cells(self, wanted: Sequence[NamedColumn]) -> list[Any]:
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

    def numbers(self, cells: Any, column: NamedColumn) -> tuple[Array, list[str]]:
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
        grouped = pc.match_substring_regex(text, GROUPED)
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

    def _mark(self, text: Any, column: NamedColumn) -> str:
        """Return the decimal mark of a column of text, as `mark_of`; ValueError if the mark is ambiguous."""
        every = max(1, len(text) // 5000)
        others = (cell for row in self._table.rows[:200] for cell in row.cells)
        try:
            return mark_of(text[::every].to_pylist(), others, column.unit, self._said.get("decimal", ""))
        except ValueError as error:
            raise ValueError(f"{self.path}: column {column.name!r}: {error}") from error

    def seconds(self, columns: Sequence[NamedColumn], cells: Sequence[Any]) -> tuple[Array, str, list[str]]:
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

    def _of_numbers(self, numbers: Array, column: NamedColumn) -> Array:
        try:
            return table_times.of_numbers(numbers, column.unit)
        except table_times.UnknownUnitError as error:
            raise ValueError(
                f"{self.path}: time (column {column.name!r}) has no unit and {error}; set it with --columns"
                f" time_ms={column.name} or time_s={column.name}"
            ) from error


def _line(table: Table) -> int:
    """Return the number of lines of the file above the first row of its table; 0 if unknown."""
    found = re.search(r"line (\d+)$", table.rows[0].at if table.rows else table.at)
    return int(found[1]) - 1 if found else 0


def _text_table(text: str, path: str) -> Table:
    """Return the table of a text; if no names were found, lines of titles above the names are left out."""
    table = table_of(text.encode(), path, is_header, are_units)
    if not is_header(table.names):
        lines = text.splitlines()
        for k, line in enumerate(lines[:_TITLES]):
            if any(is_header(line.split(separator)) for separator in ",;\t|"):
                # Replace the titles by empty lines, so that the line numbers do not change.
                return table_of(("\n" * k + "\n".join(lines[k:])).encode(), path, is_header, are_units)
    return table


def _head_of(columns: Mapping[str, list[str]], path: str) -> Table:
    """Return the first rows of columns as a table."""
    first = [column[:200] for column in columns.values()]
    rows = tuple(Row(f"{path}, sample {k + 1}", cells) for k, cells in enumerate(zip(*first, strict=True)))
    return Table(path, path, tuple(columns), ("",) * len(columns), rows)


def _nearest(column: NamedColumn, others: Sequence[NamedColumn]) -> list[NamedColumn]:
    """Return the other columns, sorted so that columns of the same object as `column` come first."""
    above = column.name.rpartition(".")[0]
    return sorted(others, key=lambda one: one.name.rpartition(".")[0] != above)


def _all_units(cells: Any) -> set[str]:
    """Return the units in an Arrow array of text."""
    return {unit_of(text or "") for text in cells.unique().to_pylist()} - {""}


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
