# SPDX-License-Identifier: Apache-2.0
"""
Times of a table: numbers, dates and clocks of any usual kind as seconds, in order.

A column is judged as a whole: the epoch of its numbers by their size and steps, the order of day and month by the dates
that exist, the order of its rows by the steps between them.
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_surface.receiver.lone_stamps import lone

UNITS = {
    "s": 1.0,
    "sec": 1.0,
    "secs": 1.0,
    "second": 1.0,
    "seconds": 1.0,
    "ms": 1e-3,
    "msec": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "minutes": 60.0,
    "h": 3600.0,
    "hr": 3600.0,
    "hrs": 3600.0,
    "hour": 3600.0,
    "hours": 3600.0,
    "d": 86_400.0,
    "days": 86_400.0,
}
_DAY_S = 86_400.0
# Units of times since an epoch: the number above which a unit is used, and the unit, s. For the years 2001 to 2100 the
# size of the numbers distinguishes Unix ns, 100 ns (Windows, .NET), Unix us, ms and s.
_EPOCHS = ((9e17, 1e-9), (1e17, 1e-7), (1e14, 1e-6), (1e11, 1e-3), (1e8, 1.0))
# Numbers above `_SERIAL` with steps below `_SERIAL_STEP` (9 s) are days since 1900 (spreadsheets) or since year 0.
_SERIAL, _SERIAL_STEP = 2e4, 1e-4
_SLOWEST_CLOCK_S = 10.0  # longest time between rows whose times are digits of a clock; slower rows show no pulses
_RECENT = 20  # number of times among which the end of a minute is searched
_LATE_S = 600.0  # largest delay of a row relative to its neighbours, s
_DAY = (
    r"(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})"
    r"|(?P<cy>\d{4}|\d{2})(?P<cm>\d{2})(?P<cd>\d{2})"
    r"|(?P<a>\d{1,2})[-/.](?P<b>\d{1,2})[-/.](?P<z>\d{4}|\d{2})"
    r"|(?P<nd>\d{1,2})\.?[-/. ]?(?P<nm>\pL{3,9})\.?[-/., ]*(?P<ny>\d{4}|\d{2})"
    r"|(?P<um>\pL{3,9})\.? (?P<ud>\d{1,2}),? (?P<uy>\d{4})"
)
_CLOCK = (
    r"(?P<h>\d{1,4}):(?P<n>\d{2})(?::(?P<s>\d{2})(?:[.,:](?P<f>\d*))?)?\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
    r"|(?P<ch>\d{2})(?P<cn>\d{2})(?P<cs>\d{2})(?:[.,](?P<cf>\d*))?"
    r"|(?P<mm>\d{1,4}):(?P<ms>\d{2})[.,](?P<mf>\d+)"
)
_ZONE = r"\s?(?:Z|[A-Z]{3,4}|(?P<zs>[+-])(?P<zh>\d{2}):?(?P<zm>\d{2}))?"
_MOMENT = rf"^(?:(?:\pL{{2,9}}\.?,? )?(?:{_DAY})(?:[T ,;_]+|$))?(?:{_CLOCK})?{_ZONE}$"
# First letters of the months where German, French, Spanish and Norwegian differ from English.
_MONTHS = {
    **{dt.date(2000, k, 1).strftime("%b").lower(): k for k in range(1, 13)},
    **dict(zip(("mär", "mai", "okt", "dez", "des"), (3, 5, 10, 12, 12), strict=True)),
    **dict(zip(("fév", "avr", "aoû", "déc", "ene", "abr", "ago", "dic"), (2, 4, 8, 12, 1, 4, 8, 12), strict=True)),
    **dict(zip(("juin", "juil"), (6, 7), strict=True)),
}


class UnknownUnitError(ValueError):
    """Raised for times without a unit whose steps may be seconds or milliseconds."""


def of_numbers(numbers: Array, unit: str) -> Array:
    """
    Return the times in a column of numbers, s, counted from the origin of the numbers; unit: "" if unknown.

    Without a unit the numbers may also be clocks HHMMSS.ff. Clocks count from midnight, and continue after the next
    midnight.

    Raises
    ------
    UnknownUnitError
        The unit is unknown, and neither the size nor the steps of the numbers show it.
    """
    if unit in UNITS:
        return numbers * UNITS[unit]
    clock = clock_of_digits(numbers)
    return numbers * _factor(numbers) if clock is None else clock + _DAY_S * _midnights(clock)


def _factor(numbers: Array) -> float:
    """
    Return the factor to seconds of times whose unit is not stated, found from the size and the steps of the numbers.

    Raises UnknownUnitError if the numbers do not show the unit.
    """
    known = numbers[np.isfinite(numbers)]
    if known.size < 2:
        raise UnknownUnitError("too few rows to tell s from ms")
    usual = float(np.median(known))
    for least, factor in _EPOCHS:
        if usual > least:
            return factor
    steps = np.abs(np.diff(known))
    moving = steps[steps > 0.0]
    if usual > _SERIAL and moving.size and float(np.median(moving)) < _SERIAL_STEP:
        return _DAY_S
    step = float(np.median(steps))
    if not step < 1.0:
        raise UnknownUnitError(f"steps by {step:g}, which may be s or ms")
    return 1.0


def clock_of_digits(numbers: Array) -> Array | None:
    """
    Return the seconds of the day of numbers HHMMSS.ff; None unless their steps show that they are a clock.

    Numbers are a clock if none has more than 59 minutes or seconds, and if a new minute or hour (5959.99 to 10000)
    comes after the usual step of the clock. Within one minute a clock and plain seconds have the same steps.
    """
    known = np.isfinite(numbers)
    own = numbers[known]
    if own.size < 3 or not _may_be_clock(own):
        return None
    steps = np.abs(np.diff(_clock(own)))
    steps = np.minimum(steps, _DAY_S - steps)
    plain = np.abs(np.diff(own))
    moving = steps[steps > 0.0]
    usual = float(np.median(moving)) if moving.size else math.inf
    turns = np.abs(plain - steps) > 1.0
    even_as_clock, even_as_seconds = (int((turns & (one <= 2.0 * usual)).sum()) for one in (steps, plain))
    if usual > _SLOWEST_CLOCK_S or even_as_clock <= even_as_seconds:
        return None
    return _clock(numbers)


def _may_be_clock(numbers: Array) -> bool:
    """Return whether all numbers are clocks HHMMSS.ff."""
    parts = (numbers // 1e4 < 24.0, numbers // 100.0 % 100.0 < 60.0, numbers % 100.0 < 60.0, numbers >= 0.0)
    return bool(np.all(parts))


def _clock(numbers: Array) -> Array:
    return np.asarray(numbers // 1e4 * 3600.0 + numbers // 100.0 % 100.0 * 60.0 + numbers % 100.0)


def _midnights(clock: Array, last: float = math.nan) -> Array:
    """
    Return the number of midnights between the first clock time and each clock time.

    A fall by more than half a day is a midnight; a rise by nearly a day is a late row of the day before.

    Parameters
    ----------
    clock : ndarray, shape (n,)
        Seconds of the day; NaN where unknown.
    last : float
        Clock time before the first one; if given, midnights are counted from it.
    """
    known = np.flatnonzero(np.isfinite(clock))
    days = np.zeros(clock.size)
    if known.size:
        own = clock[known]
        steps = np.diff(own, prepend=own[0] if math.isnan(last) else last)
        days[known] = np.cumsum((steps < -0.5 * _DAY_S).astype(float) - (steps > _DAY_S - _LATE_S))
    return days


def of_text(text: Any) -> Array:
    """
    Return the times in a column of text (an Arrow array), s since 1970; NaN where a cell is neither date nor clock.

    Clocks without a date count from midnight, and continue after the next midnight. An offset from UTC in a cell is
    subtracted.
    """
    clock, ways = _moments(text)
    order, _ = _order(ways)
    return clock + _DAY_S * (_midnights(clock) if order is None else ways[order])


def _moments(text: Any) -> tuple[Array, list[Array]]:
    """
    Return the seconds of the day of an Arrow array of text, and its days since 1970 in each order of day, month, year.

    Each array has the shape (n,), with NaN where a cell has no clock or no possible date.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    parts = pc.extract_regex(text, pattern=_MOMENT)

    def field(name: str) -> Any:
        return pc.struct_field(parts, name)

    def part(name: str) -> Array:
        one = field(name)
        return array(pc.cast(pc.if_else(pc.equal(one, ""), None, one), "float64"))

    def fraction(name: str) -> Array:
        one = pc.binary_join_element_wise("0.", field(name), "")
        return np.nan_to_num(array(pc.cast(one, "float64")))

    def month(name: str) -> Array:
        words = pc.utf8_lower(field(name))
        unique = [word for word in pc.unique(words).to_pylist() if word]
        numbers = [float(_MONTHS.get(word[:4], _MONTHS.get(word[:3], math.nan))) for word in unique]
        where = array(pc.cast(pc.index_in(words, pa.array(unique, pa.string())), "float64"))
        places = np.where(np.isfinite(where), where, len(unique)).astype(int)
        return np.asarray(np.array([*numbers, math.nan])[places])

    hour, minute, second = part("h"), part("n"), np.nan_to_num(part("s")) + fraction("f")
    half = pc.replace_substring(pc.utf8_lower(field("half")), ".", "")
    after, before = (array(pc.cast(pc.cast(pc.equal(half, word), "int8"), "float64")) for word in ("pm", "am"))
    hour = np.where(after == 1.0, hour % 12.0 + 12.0, np.where(before == 1.0, hour % 12.0, hour))
    clock = hour * 3600.0 + minute * 60.0 + second
    compact = part("ch") * 3600.0 + part("cn") * 60.0 + part("cs") + fraction("cf")
    short = part("mm") * 60.0 + part("ms") + fraction("mf")
    clock = np.where(np.isfinite(clock), clock, np.where(np.isfinite(compact), compact, short))
    zone = np.nan_to_num(part("zh") * 3600.0 + part("zm") * 60.0)
    clock -= np.where(array(pc.cast(pc.cast(pc.equal(field("zs"), "-"), "int8"), "float64")) == 1.0, -zone, zone)
    first, then, third = part("a"), part("b"), part("z")
    ways = [
        _days(*(part(name) for name in ("y", "m", "d"))),
        _days(*(part(name) for name in ("cy", "cm", "cd"))),
        _days(part("ny"), month("nm"), part("nd")),
        _days(part("uy"), month("um"), part("ud")),
        # Other orders of day, month and year. If several give valid dates, `_order` chooses the one in which the file
        # spans the shortest time.
        _days(third, then, first),
        _days(third, first, then),
        _days(np.where(third < 100.0, first, math.nan), then, third),
    ]
    return clock, ways


def _order(ways: list[Array]) -> tuple[int | None, bool]:
    """
    Return the index in `ways` of the order of day, month and year that fits, and whether no other order fits as well.

    Return None and True if there are no dates.
    """
    most = max(int(np.isfinite(days).sum()) for days in ways)
    if not most:
        return None, True
    spans = [float(np.nanmax(days) - np.nanmin(days)) if np.isfinite(days).sum() == most else math.inf for days in ways]
    return int(np.argmin(spans)), spans.count(min(spans)) == 1


class Stamps:
    """
    Times of rows that arrive one by one; the format of the cells is decided once, from the first rows.

    For a clock without a date, midnights are counted. The order of day and month is fixed by the first row that has
    only one possible order.

    Parameters
    ----------
    cells : sequence of str
        Cells of the first rows.
    numbers : ndarray, shape (n,)
        The same cells as numbers; NaN where a cell is not a number.
    unit : str
        Unit of the numbers, "" if unknown.

    Raises
    ------
    UnknownUnitError
        The cells are numbers of unknown unit, and neither their size nor their steps show it.
    ValueError
        Most of the cells are neither numbers nor times.
    """

    def __init__(self, cells: Sequence[str], numbers: Array, unit: str) -> None:
        self._first = self._last = math.nan
        self._days = 0.0
        self._factor = math.nan
        self._order: int | None = None
        self._start = ""
        self._recent = np.zeros(0)
        self._settled = bool(unit)
        known = np.isfinite(numbers)
        if known.sum() * 2 > len(cells):
            self._is_clock = not unit and clock_of_digits(numbers) is not None
            self._factor = UNITS[unit] if unit else 1.0 if self._is_clock else _factor(numbers)
            self._settled = self._settled or self._is_clock or self._factor != 1.0
            return
        clock, ways = _moments(_text(cells))
        order, _ = _order(ways)
        times = clock if order is None else clock + ways[order]
        if not np.isfinite(times).sum() * 2 > len(cells):
            raise ValueError(
                f"{next(iter(cells), '')!r} is not a time; expected seconds, 2026-03-01T12:00:00.020 or 12:00:00.02"
            )
        self._is_clock = order is None
        self._start = "" if order is None else cells[int(np.flatnonzero(np.isfinite(times))[0])]

    def seconds(self, cells: Sequence[str], numbers: Array) -> Array:
        """Return seconds since the first time, NaN for a cell without time; cells and numbers as for the first rows."""
        if math.isnan(self._factor):
            if self._start:
                return self._dated(cells)
            return self._since_first(self._of_clock(_moments(_text(cells))[0]))
        if not self._settled:
            self._judge(numbers)
        if self._is_clock:
            return self._since_first(self._of_clock(_clock(numbers)))
        return self._since_first(numbers * self._factor)

    def _judge(self, numbers: Array) -> None:
        """Decide from the last and the new numbers whether they are a clock HHMMSS.ff, as `clock_of_digits` does."""
        known = numbers[np.isfinite(numbers)]
        if not _may_be_clock(known):
            self._settled = True
            return
        before = self._recent
        self._recent = np.concatenate([before, known])
        if clock_of_digits(self._recent) is not None:
            self._is_clock = self._settled = True
            if before.size:
                self._first = float(_clock(np.array([self._first]))[0])
                self._last = float(_clock(before)[-1])
        self._recent = self._recent[-_RECENT:]

    def _dated(self, cells: Sequence[str]) -> Array:
        clock, ways = _moments(_text([self._start, *cells]))
        if self._order is None:
            order, sure = _order(ways)
            if sure:
                self._order = order
        else:
            order = self._order
        times = clock + _DAY_S * ways[order or 0]
        return np.asarray(times[1:] - times[0])

    def _of_clock(self, clock: Array) -> Array:
        days = self._days + _midnights(clock, self._last)
        known = np.flatnonzero(np.isfinite(clock))
        if known.size:
            self._last, self._days = float(clock[known[-1]]), float(days[known[-1]])
        return np.asarray(clock + _DAY_S * days)

    def _since_first(self, times: Array) -> Array:
        known = times[np.isfinite(times)]
        if known.size and math.isnan(self._first):
            self._first = float(known[0])
        return times - self._first


def _text(cells: Sequence[str]) -> Any:
    import pyarrow as pa

    return pa.chunked_array([pa.array(cells, pa.string())])


def clock_text(text: Any) -> Any:
    """
    Return clocks HHMMSS, an Arrow array of text, with leading zeros.

    Return None if at most half of the cells are numbers, or if one has more than 59 minutes or seconds.
    """
    import pyarrow.compute as pc

    parts = pc.extract_regex(text, pattern=r"^(?P<whole>\d{1,6})(?P<rest>\.\d*)?$")
    whole = pc.utf8_lpad(pc.struct_field(parts, "whole"), 6, "0")
    numbers = array(pc.cast(whole, "float64"))
    numbers = numbers[np.isfinite(numbers)]
    if not numbers.size * 2 > len(text) or (numbers % 100.0 >= 60.0).any() or (numbers // 100.0 % 100.0 >= 60.0).any():
        return None
    return pc.binary_join_element_wise(whole, pc.struct_field(parts, "rest"), "")


def array(cells: Any) -> Array:
    """Return the numbers of an Arrow column; NaN for a null cell."""
    import pyarrow as pa

    # The conversion of Arrow would import pandas, which takes longer than reading an hour of pressure.
    parts = [np.zeros(0)]
    for chunk in cells.chunks if isinstance(cells, pa.ChunkedArray) else [cells]:
        part = slice(chunk.offset, chunk.offset + len(chunk))
        values = np.frombuffer(chunk.buffers()[1], dtype=float)[part]
        if chunk.null_count:
            valid = np.frombuffer(chunk.is_valid().cast("uint8").buffers()[1], dtype=np.uint8)[: len(chunk)]
            values = np.where(valid == 1, values, math.nan)
        parts.append(values)
    return np.concatenate(parts)


def _days(year: Array, month: Array, day: Array) -> Array:
    """Return days since 1970, NaN for an impossible date; years below 100 are years of this century."""
    good = np.isfinite(year) & (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
    year = np.where(year < 100.0, year + 2000.0, year)
    months = ((np.where(good, year, 1970.0) - 1970.0) * 12.0 + np.where(good, month, 1.0) - 1.0).astype("int64")
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(float) + np.where(good, day, 1.0) - 1.0
    return np.where(good, days, math.nan)


def without_repeats(seconds: Array, values: Array) -> tuple[Indices, list[str]]:
    """
    Return the rows that do not repeat the time and the value of an earlier row, and notes.

    A file that was joined from overlapping parts, or a stream that sends each sample twice, has repeated rows. All rows
    are returned if the times would not rise strictly without the repeats, as for samples with stamps of whole seconds.

    Parameters
    ----------
    seconds, values : ndarray, shape (n,)
    """
    rows = np.arange(seconds.size)
    known = np.isfinite(seconds)
    steps = np.diff(seconds[known])
    if not (steps <= 0.0).any() or (steps < 0.0).sum() > (steps > 0.0).sum():
        return rows, []
    order = np.lexsort((rows, values, seconds))
    same = (np.diff(seconds[order]) == 0.0) & (np.diff(values[order]) == 0.0)
    kept = np.ones(seconds.size, dtype=bool)
    kept[order[1:][same]] = False
    left = seconds[kept & known]
    if kept.all() or not (np.diff(left) > 0.0).all():
        return rows, []
    return rows[kept], [f"{int((~kept).sum())} rows repeat the time and value of an earlier row and are left out"]


def in_order(seconds: Array) -> tuple[Array, Indices, list[str]]:
    """
    Return times that rise, the rows to which they belong, and notes.

    Rows that were written in another order are sorted. If sorting would interleave two parts or make a pause, the clock
    was set back, and the samples after this are taken to follow without a pause. If the times fall back too often for
    that, they are returned as they are, with a note.

    Parameters
    ----------
    seconds : ndarray, shape (n,)
        Times, s; NaN where unknown.

    Returns
    -------
    seconds : ndarray, shape (m,)
    rows : ndarray of int, shape (m,)
        Indices of the returned times in the argument, without unknown times.
    notes : list of str
    """
    rows = np.flatnonzero(np.isfinite(seconds))
    wrong = lone(seconds[rows])
    rows = rows[~wrong]
    times = seconds[rows]
    steps = np.diff(times)
    back = steps < 0.0
    said = [f"{int(wrong.sum())} rows have a time far from those around it and are left out"] if wrong.any() else []
    if not back.any():
        return times, rows, said
    if back.sum() > (steps > 0.0).sum():
        # In a file in falling order, rows with equal stamps are in falling order too, so reverse all rows.
        rows, times = rows[::-1], times[::-1]
        steps = np.diff(times)
        back = steps < 0.0
    usual = float(np.median(np.abs(steps[steps != 0.0])))
    order = np.argsort(times, kind="stable")

    def close(of: Array) -> float:
        return float(np.mean(np.abs(of) < 0.5 * usual))

    sorted_steps = np.diff(times[order])
    pauses = max(float(steps.max(initial=0.0)), 10.0 * usual)
    places = np.flatnonzero(back & (steps < -2.0 * usual)) + 1
    if not places.size or (close(sorted_steps) <= close(steps) + 1e-3 and float(sorted_steps.max()) <= pauses):
        count = int(back.sum())
        note = "the rows are not in the order of time and were sorted" if count else "the rows were in falling order"
        return times[order], rows[order], [*said, note]
    if places.size > 1e-3 * times.size + 1:
        note = (
            f"the times fall back {places.size} times, first by {-steps[places[0] - 1]:.6g} s; that is too often for a"
            " clock that was set back, and the rows are kept in their order: check the column of time"
        )
        return times, rows, [*said, note]
    by = np.zeros(times.size)
    by[places] = usual - steps[places - 1]
    first = places[0]
    note = (
        f"the clock of the file is set back {places.size} times, first by {-steps[first - 1]:.6g} s; the samples after"
        " it are taken to follow without a pause"
    )
    return times + np.cumsum(by), rows, [*said, note]


def spread(seconds: Array) -> tuple[Array, list[str]]:
    """
    Return times, s, and notes; samples that share a stamp get evenly spaced times up to the next stamp.

    The times are returned unchanged, without a note, unless more than half of their steps are 0 and none is below 0.
    """
    if seconds.size < 8:
        return seconds, []
    steps = np.diff(seconds)
    if not (steps == 0.0).mean() > 0.5 or (steps < 0.0).any() or not (steps > 0.0).any():
        return seconds, []
    tick = float(np.median(steps[steps > 0.0]))
    even_times = seconds.copy()
    for part in np.split(np.arange(seconds.size), np.flatnonzero(steps > 1.5 * tick) + 1):
        own = seconds[part]
        changes = np.flatnonzero(np.diff(own) > 0.0)
        if changes.size < 2:
            rate = float(part.size) / tick
        else:
            rate = (changes[-1] - changes[0]) / (own[changes[-1] + 1] - own[changes[0] + 1])
        even = np.arange(part.size) / rate
        # Each sample was taken between its stamp and the next one.
        late = own - even
        even_times[part] = even + 0.5 * (float(np.max(late)) + float(np.min(late + tick)))
    each = seconds.size / max(1, int((steps > 0.0).sum()) + 1)
    return even_times, [
        f"the times step by {tick:g} s for about {each:.0f} samples each; the samples are spread evenly between them"
    ]
