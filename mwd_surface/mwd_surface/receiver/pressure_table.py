# SPDX-License-Identifier: Apache-2.0
"""
Columns of time and pressure in a table as a rig writes it: names, units and times of any usual kind.

The table layer of the lists finds encoding, separator, names and units in the first lines; the rows, which may be many
millions, are read by Arrow. A cell that is not a number is a missing sample and is counted.
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
from mwd_sensors.core.input_files import check_regular
from mwd_surface.list_files.number_cells import NULL_NUMBERS, looks_like_number
from mwd_surface.list_files.table import Table, table_of

_HEAD = 20_000  # bytes in which names, units and the first rows stand
_FULL_SCALE = 1.0e7  # Pa of a gauge whose range is not known: 20 mA, or 1 in a WAV
_LIVE_ZERO, _SPAN, _BROKEN = (
    4e-3,
    16e-3,
    3.6e-3,
)  # A; current loop of 4 to 20 mA, below 3.6 mA the wire is broken (NAMUR)
_TIMES = {
    "s": 1.0,
    "sec": 1.0,
    "secs": 1.0,
    "seconds": 1.0,
    "ms": 1e-3,
    "msec": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
}
_PRESSURES = {
    "pa": 1.0,
    "kpa": 1e3,
    "mpa": 1e6,
    "mbar": 100.0,
    "bar": 1e5,
    "barg": 1e5,
    "bars": 1e5,
    "psi": 6894.757293168,
    "psig": 6894.757293168,
    "atm": 101_325.0,
    "kgcm": 98_066.5,
    "v": 1.0,
    "mv": 1e-3,
    "ma": 1e-3,
}
_TIME = re.compile(
    r"^(?:rig |local |utc |gps |unix |elapsed |sample |log )?"
    r"(?:time ?stamp|time|t|datetime|date ?time|epoch|stamp|clock|时间|zeit|uhrzeit|tiempo|temps|tid)\b"
)
_DATE = re.compile(r"^(?:date|day|日期|datum|fecha|dato)\b")
_PRESSURE = re.compile(
    r"^(?:stand ?pipe|spp ?a?|sppa|pump ?press|press|voltage|volts?|p\b|pressure|current|loop|立压|立管压力|泵压|"
    r"druck|presion|pression|trykk)"
)
_PUMP = re.compile(r"^(?:pump|pump no|pump number|泵)\b")
_MARKS = re.compile(r"[^\w./%]+|_")
# A date in front of a clock, either alone, or a clock with parts of a second and a half of the day.
_DAY = r"(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})|(?P<a>\d{1,2})[-/.](?P<b>\d{1,2})[-/.](?P<z>\d{4})"
_CLOCK = r"(?P<h>\d{1,2}):(?P<n>\d{2})(?::(?P<s>\d{2}(?:\.\d*)?))?\s*(?P<half>[AaPp][Mm])?"
_ZONE = r"(?:Z|UTC|[+-]\d{2}:?\d{2})?"
_MOMENT = rf"^(?:(?:{_DAY})(?:[T ,;]+|$))?(?:{_CLOCK})?{_ZONE}$"
_NUMBER = r"^[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?$"
# Unix times by their size: ns, us, ms and s of the years 2001 to 2100.
_EPOCHS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3), (1e8, 1.0))
_DAY_S = 86_400.0


@dataclasses.dataclass(frozen=True)
class _Column:
    """One column: its place in a row, its name and its unit, "" where it names none."""

    number: int
    name: str
    unit: str


def columns_of(text: str) -> dict[str, str]:
    """
    Return which column is what, as written by a user: "time=Zeit,pressure_bar=SPP" or "time_s=1,pressure_bar=2".

    Raises
    ------
    ValueError
        A part without "=", or a quantity that does not exist.
    """
    pairs = {}
    for part in filter(None, text.split(",")):
        quantity, equals, column = part.partition("=")
        quantity = quantity.strip().lower()
        if not equals or quantity.partition("_")[0] not in ("date", "time", "pressure", "pump"):
            raise ValueError(
                f"--columns {part}: write time=NAME, date=NAME or pressure_bar=NAME; a number counts columns from 1"
            )
        pairs[quantity] = column.strip()
    return pairs


def read_pressure(path: Path, gauge: int, columns: Mapping[str, str]) -> tuple[Array, Array, str, tuple[str, ...]]:
    """
    Return times, s, pressure, Pa, what time 0 is, and what is wrong with the table.

    Parameters
    ----------
    path : Path
    gauge : int
        Which of the columns of pressure, from 1.
    columns : mapping of str
        What the caller says of the columns; see `columns_of`.

    Raises
    ------
    ValueError
        No column of time or pressure, or one whose unit nothing names.
    OSError
        The file cannot be read.
    """
    file = _TableFile(path, columns)
    times = file.times()
    pressures = file.found("pressure", _PRESSURE)
    if len(pressures) < gauge:
        raise ValueError(
            file.missing("pressure", f"a column of pressure for gauge {gauge}" if pressures else "a column of pressure")
        )
    column = pressures[gauge - 1]
    if column.unit not in _PRESSURES:
        raise ValueError(
            f"{path}: pressure (column {column.name!r}) has no unit that is one of a pressure; write pressure_bar or a"
            f" line of units, or say it with --columns pressure_bar={column.name}; units: {', '.join(_PRESSURES)}"
        )
    cells = file.cells([*times, column])
    time, origin, notes = _time(path, times, cells[:-1], file.comma)
    if file.skipped:
        notes.append(f"{file.skipped} lines have another number of cells, such as comments, and are left out")
    pressure, more = _numbers(cells[-1], file.comma)
    notes += more
    if column.unit == "ma":
        pressure, said = _of_current(pressure * 1e-3)
        notes += said
    else:
        pressure = pressure * _PRESSURES[column.unit]
    return time, pressure, origin, tuple(notes)


def read_numbers(path: Path, columns: Mapping[str, str]) -> tuple[Array, Array]:
    """
    Return pump numbers and times, s, of a table of strokes.

    Raises
    ------
    ValueError
        A column is missing, or a pump is not a number.
    OSError
        The file cannot be read.
    """
    file = _TableFile(path, columns)
    pumps, times = file.found("pump", _PUMP), file.times()
    if not pumps:
        raise ValueError(file.missing("pump", "a column pump"))
    cells = file.cells([*times, pumps[0]])
    time, _, _ = _time(path, times, cells[:-1], file.comma)
    return _numbers(cells[-1], file.comma)[0], time


class _TableFile:
    """A table whose head is known: where its rows begin, how they part, and what its columns are."""

    def __init__(self, path: Path, columns: Mapping[str, str]) -> None:
        size = check_regular(path, budgets.PRESSURE)
        with path.open("rb") as file:
            start = file.read(_HEAD)
        self.path, self._said, self.skipped = path, columns, 0
        self._encoding = _encoding(start)
        text = start.decode(self._encoding, errors="ignore")
        if size > len(start):
            text = text[: text.rfind("\n") + 1] or text
        self._table = table_of(text.encode(), str(path), _is_header, _are_units)
        self.headless = any(looks_like_number(name) for name in self._table.names)
        rows = self._table.rows[:200]
        self.comma = self._table.separator != "," and any(
            re.search(r"\d,\d", str(cell)) for row in rows for cell in row.cells
        )

    def found(self, quantity: str, pattern: re.Pattern[str]) -> list[_Column]:
        """Columns of a quantity in order, or the one that the caller names."""
        table = self._table
        for key, name in self._said.items():
            if key.partition("_")[0] == quantity:
                return [self._named(name, key.partition("_")[2])]
        if self.headless:
            return []
        pairs = [
            (k, name, *_words(name, table.units[k] if k < len(table.units) else ""))
            for k, name in enumerate(table.names)
        ]
        return [_Column(k, name, unit) for k, name, words, unit in pairs if pattern.match(words)]

    def _named(self, name: str, unit: str) -> _Column:
        """The column of a name, or of a number from 1."""
        names = [one.strip().lower() for one in self._table.names]
        if name.lower() in names and not self.headless:
            k = names.index(name.lower())
            own = _words(self._table.names[k], self._table.units[k])[1]
            return _Column(k, self._table.names[k], unit or own)
        if name.isdecimal() and 1 <= int(name) <= len(names):
            return _Column(int(name) - 1, name, unit)
        raise ValueError(f"--columns {name}: {self.path} has no such column; it has {', '.join(self._table.names)}")

    def missing(self, quantity: str, what: str) -> str:
        """Say that a column is missing, and how to name it."""
        if self.headless:
            return f"{self.path}: no line names the columns; say which are which with --columns time_s=1,pressure_bar=2"
        return (
            f"{self.path}: there is not {what}; the columns are {', '.join(self._table.names)}; name them as in"
            f" time_s,pressure_bar, or say it with --columns {quantity}=NAME"
        )

    def times(self) -> list[_Column]:
        """Columns of the time: the time, with the date before it where it has a column of its own."""
        clocks = self.found("time", _TIME)
        if not clocks:
            raise ValueError(self.missing("time", "a column of time"))
        dates = self.found("date", _DATE)
        dates = [one for one in dates if one.number != clocks[0].number]
        first = next(
            (str(row.cells[clocks[0].number]) for row in self._table.rows if clocks[0].number < len(row.cells)), ""
        )
        # A date beside times that have one, or that count seconds, is not needed.
        return (
            [*dates[:1], clocks[0]]
            if re.fullmatch(r"\d{1,2}:\d{2}(:\d{2}([.,]\d*)?)?( ?[AaPp][Mm])?", first.strip())
            else clocks[:1]
        )

    def cells(self, wanted: Sequence[_Column]) -> list[Any]:
        """The cells of columns as Arrow arrays of text."""
        import pyarrow as pa

        first = 0 if self.headless else _line(self._table)
        width = max((len(row.cells) for row in self._table.rows[:50]), default=len(self._table.names))
        width = max(width, *(one.number + 1 for one in wanted))
        separator = self._table.separator
        if separator.startswith(" ") or not separator:
            return [
                pa.chunked_array([pa.array(column, pa.string())])
                for column in self._split(first, [one.number for one in wanted])
            ]
        names = [str(k) for k in range(width)]
        wordless = [all(self._is_plain(row.cells, one.number) for row in self._table.rows[:50]) for one in wanted]
        kinds = [pa.float64() if plain else pa.string() for plain in wordless]
        for types in (kinds, [pa.string()] * len(kinds)):
            try:
                return self._read(types, [str(one.number) for one in wanted], names, first)
            except pa.ArrowInvalid as error:
                # A cell that is not a number, if it was not text already.
                if pa.float64() not in types:
                    raise ValueError(f"{self.path}: cannot be read as a table: {error}") from error
        raise AssertionError

    def _is_plain(self, cells: Sequence[Any], number: int) -> bool:
        """Whether a cell is a number as Arrow reads one."""
        text = str(cells[number]) if number < len(cells) else ""
        return bool(re.match(_NUMBER, text.replace(",", ".") if self.comma else text))

    def _read(self, types: Sequence[Any], wanted: list[str], names: list[str], first: int) -> list[Any]:
        """Columns by their names in the types asked for; pyarrow.ArrowInvalid where a cell is not of its type."""
        from pyarrow import csv

        skipped: list[int] = []

        def skip(row: Any) -> str:
            # Arrow counts rows only where it reads with one thread.
            skipped.append(row.actual_columns)
            return "skip"

        with self.path.open("rb") as file:
            table = csv.read_csv(
                file,
                csv.ReadOptions(skip_rows=first, column_names=names, encoding=self._encoding),
                csv.ParseOptions(delimiter=self._table.separator, invalid_row_handler=skip),
                csv.ConvertOptions(
                    column_types=dict(zip(wanted, types, strict=True)),
                    include_columns=wanted,
                    strings_can_be_null=False,
                    decimal_point="," if self.comma else ".",
                ),
            )
        self.skipped = len(skipped)
        try:
            budgets.PRESSURE.check("records", table.num_rows)
        except BudgetError as error:
            raise ValueError(f"{self.path}: {error}") from error
        return [table.column(name) for name in wanted]

    def _split(self, first: int, numbers: Sequence[int]) -> list[list[str]]:
        """Cells of columns that spaces part."""
        columns: list[list[str]] = [[] for _ in numbers]
        with io.TextIOWrapper(self.path.open("rb"), encoding=self._encoding, errors="replace") as file:
            for k, line in enumerate(file):
                cells = line.split()
                if k >= first and len(cells) > max(numbers) and not line.lstrip().startswith(("#", "!", "%")):
                    for column, number in zip(columns, numbers, strict=True):
                        column.append(cells[number])
        return columns


def _line(table: Table) -> int:
    """Lines above the first row."""
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


def _words(name: str, unit: str) -> tuple[str, str]:
    """Words of a name in lower case without its unit, and the unit."""
    brackets = re.findall(r"[(\[{]([^)\]}]*)[)\]}]?", name)
    words = " ".join(_MARKS.sub(" ", re.sub(r"[(\[{][^)\]}]*[)\]}]?", " ", name)).lower().split())
    own = [_unit(one) for one in (unit, *brackets) if _unit(one)]
    last = words.rpartition(" ")[2]
    if not own and " " in words and (last in _TIMES or last in _PRESSURES):
        own, words = [last], words.rpartition(" ")[0]
    return words, own[0] if own else ""


def _unit(text: str) -> str:
    word = "".join(c for c in text.lower() if c.isalpha())
    return word if word in _TIMES or word in _PRESSURES else ""


def _is_header(names: Sequence[str]) -> int:
    words = [_words(str(name), "")[0] for name in names]
    quantities = sum(any(pattern.match(one) for one in words) for pattern in (_TIME, _PRESSURE, _DATE, _PUMP))
    return quantities if quantities > 1 and not any(looks_like_number(name) for name in names) else 0


def _are_units(cells: Sequence[str]) -> int:
    words = [str(cell).strip("()[] ") for cell in cells]
    return int(any(_unit(word) for word in words) and not any(looks_like_number(word) for word in words))


def _numbers(cells: Any, comma: bool) -> tuple[Array, list[str]]:
    """Numbers of cells, nan where a cell has none or a null value, and how many have one."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_floating(cells.type):
        return _without_nulls(_array(cells))
    text = pc.utf8_trim_whitespace(cells)
    if comma:
        text = pc.replace_substring(text, ",", ".")
    is_number = pc.match_substring_regex(text, _NUMBER)
    kept = pc.if_else(is_number, text, pa.scalar(None, pa.string()))
    values, notes = _without_nulls(_array(pc.cast(kept, pa.float64())))
    words = pc.and_(pc.invert(is_number), pc.greater(pc.utf8_length(text), 0))
    if count := pc.sum(words).as_py():
        example = text.filter(words)[0].as_py()[:20]
        notes.append(f"{count} cells have a word in place of a number, such as {example!r}, and are missing samples")
    return values, notes


def _array(cells: Any) -> Array:
    """Numbers of a column of Arrow; nan where a cell has none."""
    # Arrow's own conversion would import pandas, which takes longer than an hour of pressure.
    parts = [np.zeros(0)]
    for chunk in cells.chunks:
        part = slice(chunk.offset, chunk.offset + len(chunk))
        values = np.frombuffer(chunk.buffers()[1], dtype=float)[part]
        if chunk.null_count:
            valid = np.frombuffer(chunk.is_valid().cast("uint8").buffers()[1], dtype=np.uint8)[: len(chunk)]
            values = np.where(valid == 1, values, math.nan)
        parts.append(values)
    return np.concatenate(parts)


def _without_nulls(values: Array) -> tuple[Array, list[str]]:
    """Numbers with nan in place of null values, and how many there are."""
    null = np.isin(values, NULL_NUMBERS)
    if not null.any():
        return values, []
    note = f"{int(null.sum())} cells have the null value {values[null][0]:g} and are missing samples"
    return np.where(null, math.nan, values), [note]


def _time(path: Path, columns: Sequence[_Column], cells: Sequence[Any], comma: bool) -> tuple[Array, str, list[str]]:
    """Times, s, what time 0 is, and notes, of one column of times, or of a date and a clock."""
    import pyarrow.compute as pc

    column, text = columns[-1], cells[-1]
    if len(columns) > 1:
        text = pc.binary_join_element_wise(*(pc.utf8_trim_whitespace(pc.cast(one, "string")) for one in cells), " ")
    numbers, notes = _numbers(text, comma)
    # Most cells decide: a word here and there is a missing sample.
    if np.isfinite(numbers).sum() * 2 > len(numbers):
        seconds = numbers * _time_unit(path, column, numbers)
    else:
        text = pc.utf8_trim_whitespace(pc.cast(text, "string"))
        seconds, notes = _moments(pc.replace_substring(text, ",", ".") if comma else text), []
        if not np.isfinite(seconds).sum() * 2 > len(seconds):
            example = text[0].as_py() if len(text) else ""
            raise ValueError(
                f"{path}: {column.name}: {example!r} is not a time; expected seconds, 2026-03-01T12:00:00.020 or"
                " 12:00:00.02"
            )
    seconds, said = _spread(seconds)
    start = float(np.nanmin(seconds, initial=math.inf))
    if math.isfinite(start) and start > _DAY_S * 365.0:
        seconds = seconds - start
        return seconds, f"first time of the file ({column.name})", notes + said
    return seconds, f"{column.name} of the file", notes + said


def _time_unit(path: Path, column: _Column, numbers: Array) -> float:
    """Factor of numbers that are times: by their name, as Unix times by their size, or s where they step like them."""
    if column.unit in _TIMES:
        return _TIMES[column.unit]
    usual = float(np.nanmedian(numbers))
    for least, factor in _EPOCHS:
        if usual > least:
            return factor
    step = float(np.nanmedian(np.diff(numbers[np.isfinite(numbers)])))
    if not step < 1.0:
        raise ValueError(
            f"{path}: time (column {column.name!r}) has no unit and steps by {step:g}, which may be s or ms; say it"
            f" with --columns time_ms={column.name} or time_s={column.name}"
        )
    return 1.0


def _moments(text: Any) -> Array:
    """Seconds of dates and clocks; a clock alone goes on behind midnight; nan where a cell is neither."""
    import pyarrow.compute as pc

    parts = pc.extract_regex(text, pattern=_MOMENT)

    def part(name: str) -> Array:
        field = pc.struct_field(parts, name)
        number = pc.cast(pc.if_else(pc.equal(field, ""), None, field), "float64")
        return _array(number)

    hour, minute, second = part("h"), part("n"), np.nan_to_num(part("s"))
    half = pc.utf8_lower(pc.struct_field(parts, "half"))
    after, before = (_array(pc.cast(pc.cast(pc.equal(half, word), "int8"), "float64")) for word in ("pm", "am"))
    hour = np.where(after == 1.0, hour % 12.0 + 12.0, np.where(before == 1.0, hour % 12.0, hour))
    clock = hour * 3600.0 + minute * 60.0 + second
    year, month, day = part("y"), part("m"), part("d")
    if np.isfinite(year).any():
        return clock + _DAY_S * _days(year, month, day)
    first, then, year = part("a"), part("b"), part("z")
    if np.isfinite(year).any():
        # Day and month by what can be; where both can, the order in which the file is shorter.
        ways = [_days(year, *pair) for pair in ((then, first), (first, then))]
        good = [days for days in ways if np.isfinite(days).sum() == max(np.isfinite(w).sum() for w in ways)]
        return clock + _DAY_S * min(good, key=lambda days: float(np.nanmax(days) - np.nanmin(days)))
    known = np.flatnonzero(np.isfinite(clock))
    over = np.concatenate([[0.0], np.cumsum(np.diff(clock[known]) < -0.5 * _DAY_S)]) if known.size else np.zeros(0)
    clock[known] += over * _DAY_S
    return clock


def _days(year: Array, month: Array, day: Array) -> Array:
    """Days since 1970; nan where there is no such day."""
    good = np.isfinite(year) & (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
    months = ((np.where(good, year, 1970.0) - 1970.0) * 12.0 + np.where(good, month, 1.0) - 1.0).astype("int64")
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(float) + np.where(good, day, 1.0) - 1.0
    return np.where(good, days, math.nan)


def _spread(seconds: Array) -> tuple[Array, list[str]]:
    """Times of samples whose stamps are coarser than they are: even between the stamps, gap by gap."""
    known = np.flatnonzero(np.isfinite(seconds))
    if known.size < 8:
        return seconds, []
    stamps = seconds[known]
    steps = np.diff(stamps)
    if not (steps == 0.0).mean() > 0.5 or (steps < 0.0).any() or not (steps > 0.0).any():
        return seconds, []
    tick = float(np.median(steps[steps > 0.0]))
    spread = stamps.copy()
    for part in np.split(np.arange(stamps.size), np.flatnonzero(steps > 1.5 * tick) + 1):
        own = stamps[part]
        changes = np.flatnonzero(np.diff(own) > 0.0)
        if changes.size < 2:
            rate = float(part.size) / tick
        else:
            rate = (changes[-1] - changes[0]) / (own[changes[-1] + 1] - own[changes[0] + 1])
        even = np.arange(part.size) / rate
        # Each sample was taken between its stamp and the next one.
        late = own - even
        spread[part] = even + 0.5 * (float(np.max(late)) + float(np.min(late + tick)))
    out = seconds.copy()
    out[known] = spread
    each = stamps.size / max(1, int((steps > 0.0).sum()) + 1)
    return out, [
        f"the times step by {tick:g} s for about {each:.0f} samples each; the samples are spread evenly between them"
    ]


def _of_current(current: Array) -> tuple[Array, list[str]]:
    """Pressure of a current loop of 4 to 20 mA, A, whose range is not known; nan where the wire is broken."""
    broken = current < _BROKEN
    notes = [
        f"a current of 4 to 20 mA: the range of the gauge is not known, 20 mA is taken as {_FULL_SCALE / 1e5:g} bar"
    ]
    if broken.any():
        notes.append(f"{int(broken.sum())} samples are below 3.6 mA, as of a broken wire, and are missing samples")
    return np.where(broken, math.nan, (current - _LIVE_ZERO) / _SPAN * _FULL_SCALE), notes
