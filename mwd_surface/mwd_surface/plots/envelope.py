# SPDX-License-Identifier: Apache-2.0
"""
A long signal as wide as a picture: lowest and highest value in each of a fixed number of bins of time.

Memory does not grow with the signal; a peak of one sample stays a peak however much is drawn; a signal with no more
than one sample in a bin is kept as it is.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array, Stamps

# A hole in the line wherever samples are further apart than this many times their usual distance.
_GAP = 5.0


class Envelope:
    """
    Lowest and highest value of k columns in each bin of a span of time.

    Parameters
    ----------
    start_ns, end_ns : int
        The span; samples outside are left out.
    columns : int
    bins : int
    circle : float
        Above zero: the values are angles that come round after so much. They are taken as near as possible to the
        first of their column, so that a line does not jump where it passes north.

    Raises
    ------
    ValueError
        The span is empty, or there is no bin or column.
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
        """Whether every sample is kept by itself."""
        return int(self._count.max()) <= 1

    @property
    def samples(self) -> int:
        """Samples taken."""
        return int(self._count.sum())

    def add(self, stamp_ns: Stamps, values: Array) -> None:
        """
        Take samples, in any order of time.

        stamp_ns, shape (n,); values, shape (n, columns): what is not finite counts as missing.
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
        # Floats: nanoseconds times bins would not fit an integer for a run of days.
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
        One column as a line to draw: seconds from the start of the span, and values.

        A bin with several samples gives its lowest and its highest value at one time; a nan breaks the line where
        samples are missing, or where an angle went round.
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
