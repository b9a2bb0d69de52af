# SPDX-License-Identifier: Apache-2.0
"""
Times of the rows of a table: numbers, dates and clocks of any usual kind as seconds, in order.

A column is judged as a whole: the epoch of its numbers by their size and steps, the order of its rows by the steps
between them. `list_files.moments` reads dates and clocks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_surface.list_files.moments import DAY_S, array, midnights, moments, order_of, text_array
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
# Units of times since an epoch: the number above which a unit is used, and the unit, s. For the years 2001 to 2100 the
# size of the numbers distinguishes Unix ns, 100 ns (Windows, .NET), Unix us, ms and s.
_EPOCHS = ((9e17, 1e-9), (1e17, 1e-7), (1e14, 1e-6), (1e11, 1e-3), (1e8, 1.0))
# Numbers above `_SERIAL` with steps below `_SERIAL_STEP` (9 s) are days since 1900 (spreadsheets) or since year 0.
_SERIAL, _SERIAL_STEP = 2e4, 1e-4
_SLOWEST_CLOCK_S = 10.0  # longest time between rows whose times are digits of a clock; slower rows show no pulses
_RECENT = 20  # number of times among which the end of a minute is searched


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
    return numbers * _factor(numbers) if clock is None else clock + DAY_S * midnights(clock)


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
        return DAY_S
    step = float(np.median(steps))
    if not step < 1.0:
        raise UnknownUnitError(f"rises by {step:g} per row, which may be s or ms")
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
    steps = np.minimum(steps, DAY_S - steps)
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
        clock, ways = moments(text_array(cells))
        order, _ = order_of(ways)
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
            return self._since_first(self._of_clock(moments(text_array(cells))[0]))
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
        clock, ways = moments(text_array([self._start, *cells]))
        if self._order is None:
            order, sure = order_of(ways)
            if sure:
                self._order = order
        else:
            order = self._order
        times = clock + DAY_S * ways[order or 0]
        return np.asarray(times[1:] - times[0])

    def _of_clock(self, clock: Array) -> Array:
        days = self._days + midnights(clock, self._last)
        known = np.flatnonzero(np.isfinite(clock))
        if known.size:
            self._last, self._days = float(clock[known[-1]]), float(days[known[-1]])
        return np.asarray(clock + DAY_S * days)

    def _since_first(self, times: Array) -> Array:
        known = times[np.isfinite(times)]
        if known.size and math.isnan(self._first):
            self._first = float(known[0])
        return times - self._first


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


def without_repeats(seconds: Array, values: Array) -> tuple[Indices, list[str]]:
    """
    Return the rows that do not repeat the time and the value of an earlier row, and notes.

    A file that was joined from overlapping parts, or a stream that sends each sample twice, has repeated rows. If the
    times still do not rise strictly without the repeats, as with stamps of whole seconds, all rows are returned.

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
    was set back, and the samples after this are assumed to follow without a pause. If the times fall back too often for
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
        " it are assumed to follow without a pause"
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
