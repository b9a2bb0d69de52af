# SPDX-License-Identifier: Apache-2.0
"""
A long signal at the width of a plot: lowest and highest value in each of a fixed number of time bins.

Memory does not grow with the signal; a peak of one sample remains visible at any length; a signal with at most one
sample per bin is kept unchanged.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array, Stamps

# The line is interrupted where samples are further apart than this multiple of their usual interval.
_GAP = 5.0


class Envelope:
    """
    Lowest and highest value of k columns in each time bin of a span.

    Parameters
    ----------
    start_ns, end_ns : int
        The span; samples outside are ignored.
    columns : int
    bins : int
    circle : float
        If positive, the values are angles with this period. They are unwrapped to the turn nearest to the first value
        of their column, so that a line does not jump where it passes north.

    Raises
    ------
    ValueError
        The span is empty, or there are no bins or columns.
    """

    def __init__(self, start_ns: int, end_ns: int, columns: int, bins: int = 1600, circle: float = 0.0) -> None:
        if end_ns < start_ns or columns < 1 or bins < 1:
            raise ValueError(f"an envelope needs a span, columns and bins; got {start_ns}, {end_ns}, {columns}, {bins}")
        self.circle = circle
        self._start, self._span = start_ns, end_ns - start_ns + 1
        self._low = np.full((bins, columns), np.nan)
        self._high = np.full((bins, columns), np.nan)
        self._at = np.zeros(bins, dtype=np.int64)
        self._count = np.zeros(bins, dtype=np.int64)
        self._first = np.full(columns, np.nan)

    @property
    def exact(self) -> bool:
        """Whether every sample has its own bin."""
        return int(self._count.max()) <= 1

    @property
    def samples(self) -> int:
        """Number of samples added."""
        return int(self._count.sum())

    def add(self, stamp_ns: Stamps, values: Array) -> None:
        """
        Add samples, in any order of time.

        stamp_ns, shape (n,); values, shape (n, columns): values that are not finite count as missing.
        """
        inside = (stamp_ns >= self._start) & (stamp_ns < self._start + self._span)
        if not inside.all():
            stamp_ns, values = stamp_ns[inside], values[inside]
        if len(stamp_ns) == 0:
            return
        values = np.where(np.isfinite(values), values, np.nan)
        if self.circle:
            values = self._near_first(values)
        bins = len(self._at)
        # As floats: for a run of days, nanoseconds times bins would overflow an integer.
        index = np.minimum(((stamp_ns - self._start) / self._span * bins).astype(np.int64), bins - 1)
        order = np.argsort(stamp_ns, kind="stable")
        index, stamp_ns, values = index[order], stamp_ns[order], values[order]
        heads = np.flatnonzero(np.diff(index, prepend=-1))
        hit = index[heads]
        self._low[hit] = np.fmin(self._low[hit], np.fmin.reduceat(values, heads, axis=0))
        self._high[hit] = np.fmax(self._high[hit], np.fmax.reduceat(values, heads, axis=0))
        fresh = self._count[hit] == 0
        self._at[hit] = np.where(fresh, stamp_ns[heads], np.minimum(self._at[hit], stamp_ns[heads]))
        self._count[hit] += np.diff(heads, append=len(index))

    def line(self, column: int) -> tuple[Array, Array]:
        """
        Return one column as a line to draw: seconds from the start of the span, and values.

        A bin with several samples gives its lowest and highest value at one time; a nan interrupts the line where
        samples are missing or an angle wraps.
        """
        filled = np.flatnonzero(self._count)
        seconds = np.asarray((self._at[filled] - self._start) * 1e-9, dtype=float)
        low, high = self._low[filled, column], self._high[filled, column]
        time = np.repeat(seconds, 2)
        value = np.column_stack([low, high]).ravel()
        keep = np.ones(len(value), dtype=bool)
        keep[1::2] = (low != high) & ~np.isnan(low)
        time, value = time[keep], value[keep]
        return _broken(time, value, seconds, self.circle)

    def _near_first(self, values: Array) -> Array:
        for column in np.flatnonzero(np.isnan(self._first)):
            known = values[:, column][~np.isnan(values[:, column])]
            if len(known):
                self._first[column] = known[0]
        away = (values - self._first + 0.5 * self.circle) % self.circle - 0.5 * self.circle
        return np.asarray(self._first + away)


def _broken(time: Array, value: Array, seconds: Array, circle: float) -> tuple[Array, Array]:
    if len(time) < 2:
        return time, value
    steps = np.diff(seconds)
    usual = float(np.median(steps)) if len(steps) else math.inf
    away = np.diff(time) > _GAP * usual
    if circle:
        away |= (np.abs(np.diff(value)) > 0.5 * circle) & (np.diff(time) > 0.0)
    where = np.flatnonzero(away) + 1
    return np.insert(time, where, time[where]), np.insert(value, where, np.nan)
