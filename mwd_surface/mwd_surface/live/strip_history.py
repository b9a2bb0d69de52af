# SPDX-License-Identifier: Apache-2.0
"""History of a few channels for strip charts: one row per interval of time or depth, in constant memory."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

Row = tuple[float | None, ...]


class StripHistory:
    """
    Rows of (end of interval, channel, channel, ...); an interval without data has None instead of the last value.

    Parameters
    ----------
    channels : mapping of str to "mean", "max" or "angle"
        How several values within one interval are combined; "angle" is their mean on the circle, rad in [0, 2 pi).
    seconds, rate : float
        Length of the history, s, and number of rows per second. For a history over depth: m, and rows per metre.

    Raises
    ------
    ValueError
        A combination is unknown, or the history is shorter than one row.
    """

    def __init__(self, channels: Mapping[str, str], seconds: float = 600.0, rate: float = 1.0) -> None:
        for name, how in channels.items():
            if how not in ("mean", "max", "angle"):
                raise ValueError(f"channels: {name}: expected mean, max or angle, got {how!r}")
        if not seconds * rate >= 1.0:
            raise ValueError(f"seconds, rate: need room for one row, got {seconds} s at {rate} Hz")
        self.channels = dict(channels)
        self.interval = 1.0 / rate
        self.length = seconds
        self._rows: deque[Row] = deque(maxlen=round(seconds * rate))
        self._bin: int | None = None
        self._sums: dict[str, tuple[float, int]] = {}

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the values in a row."""
        return ("at", *self.channels)

    def add(self, channel: str, value: float, now: float) -> None:
        """Add a value to the interval of `now`, s or m, unless the value is not finite or the interval is closed."""
        self.advance(now)
        if not math.isfinite(value) or self._bin is None or math.floor(now / self.interval) < self._bin:
            return
        total, count = self._sums.get(channel, (0.0, 0))
        if self.channels[channel] == "max":
            self._sums[channel] = (value if count == 0 else max(total, value), count + 1)
        elif self.channels[channel] == "angle" and count:
            # Unwrap the angle to the mean so far, so that 359 and 1 deg give 0.
            mean = total / count
            self._sums[channel] = (total + mean + math.remainder(value - mean, math.tau), count + 1)
        else:
            self._sums[channel] = (total + value, count + 1)

    def advance(self, now: float) -> None:
        """Close the interval that ended before `now`, s or m; append one empty row if further intervals passed."""
        current = math.floor(now / self.interval)
        if self._bin is None:
            self._bin = current
        if current <= self._bin:
            return
        self._rows.append(self._row(self._bin))
        self._sums = {}
        if current > self._bin + 1:
            # One empty row interrupts the line on the chart; more rows are not needed.
            self._rows.append(self._row(self._bin + 1))
        self._bin = current

    def rows(self) -> tuple[Row, ...]:
        """Return the rows of all closed intervals, oldest first."""
        return tuple(self._rows)

    def _row(self, index: int) -> Row:
        values: list[float | None] = [round((index + 1) * self.interval, 3)]
        for name, how in self.channels.items():
            total, count = self._sums.get(name, (0.0, 0))
            value = None if count == 0 else (total if how == "max" else total / count)
            if value is not None and how == "angle":
                value %= math.tau
            values.append(None if value is None else float(f"{value:.5g}"))
        return tuple(values)
