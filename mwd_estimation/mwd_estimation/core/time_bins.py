# SPDX-License-Identifier: Apache-2.0
"""
Sums over equal bins of time: what surveys are averaged from, in constant memory.

A stream is cut at multiples of the bin length since the epoch, so that the same messages fall into the same bins
however they arrive. Within a bin, sums are taken in order and about the bin's first sample, so that any cut of the
stream into blocks gives the same bits and a variance loses no digits.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Samples, Stamps
from mwd_sensors.core.compiled import compiled
from mwd_sensors.core.records import dtype_of

_NONE = np.iinfo(np.int64).min
_ROOM = 64  # bins that one call of the kernel can close


@dataclasses.dataclass(frozen=True)
class Bin:
    """One closed bin of a stream with c channels."""

    index: int  #: start of the bin over its length, both in ns since the epoch
    count: int  #: samples in it
    mean: Array  #: shape (c,); in the channels' units
    scatter: Array  #: shape (c, c); sum of outer products about the mean, in the units' squares
    #: `low`, `high`: shape (c,); extremes.
    low: Array
    high: Array


@dataclasses.dataclass(frozen=True)
class Average:
    """Mean, shape (c,), covariance of the mean, shape (c, c), and number of samples of several bins together."""

    mean: Array
    covariance: Array
    count: int


class ClosedAt:
    """Which bin, and where it closed."""

    #: `index`, `count`: as of `Bin`; index is _NONE where no bin is open.
    index: int
    count: int
    place: int  #: in the block, of the sample that closed it


_CLOSED_AT = dtype_of(ClosedAt)


class Sums(NamedTuple):
    """Of the open bin: first sample, sum, lowest and highest, shape (c,); sums of products about the first, (c, c)."""

    first: Array
    total: Array
    low: Array
    high: Array
    products: Array


class Closed(NamedTuple):
    """Bins closed in one call of the kernel: places, shape (k,); the figures of `Bin`, shapes (k, c) and (k, c, c)."""

    places: Samples
    mean: Array
    low: Array
    high: Array
    scatter: Array


class Binner:
    """Cuts one stream, of so many channels, into bins of `length_ns`."""

    def __init__(self, channels: int, length_ns: int) -> None:
        self.length_ns = length_ns
        self._open = np.zeros(1, _CLOSED_AT)
        self._open["index"] = _NONE
        first, total, low, high = np.zeros((4, channels))
        self._sums = Sums(first, total, low, high, np.zeros((channels, channels)))
        mean, lowest, highest = np.zeros((3, _ROOM, channels))
        self._closed = Closed(np.zeros(_ROOM, _CLOSED_AT), mean, lowest, highest, np.zeros((_ROOM, channels, channels)))

    def add(self, stamp_ns: Stamps, values: Array) -> list[Bin]:
        """
        Take a block, shapes (n,) and (n, channels); give the bins that it closed.

        Samples that are not finite or older than the open bin are left out. A bin closes with the
        first sample of a later one.
        """
        return [closed for closed, _ in self.add_placed(stamp_ns, values)]

    def add_placed(self, stamp_ns: Stamps, values: Array) -> list[tuple[Bin, int]]:
        """As `add`, and with each bin the place in the block of the sample that closed it."""
        closed: list[tuple[Bin, int]] = []
        start, n = 0, len(stamp_ns)
        while start < n:
            start, count = _fill(self._open, self._sums, stamp_ns, values, start, self.length_ns, self._closed)
            if count:
                closed += self._bins(count)
        return closed

    def flush(self, before_ns: int) -> list[Bin]:
        """Close the open bin where the stream fell silent and the bin ends before that time, ns."""
        index = int(self._open["index"][0])
        if index == _NONE or (index + 1) * self.length_ns > before_ns:
            return []
        _close(self._open[0], self._sums, self._closed, 0, 0)
        return [closed for closed, _ in self._bins(1)]

    def _bins(self, count: int) -> list[tuple[Bin, int]]:
        places, *figures = (column[:count].copy() for column in self._closed)
        return [
            (Bin(index, samples, mean, scatter, low, high), place)
            for (index, samples, place), mean, low, high, scatter in zip(places.tolist(), *figures, strict=True)
        ]


def average(bins: list[Bin]) -> Average:
    """
    Mean of all samples of the bins and its covariance from the scatter of all samples.

    Raises
    ------
    ValueError
        No bins, or fewer than two samples in them.
    """
    count = sum(b.count for b in bins)
    if count < 2:
        raise ValueError(f"bins: an average needs two samples at least, got {count}")
    mean = sum((b.count * b.mean for b in bins), np.zeros_like(bins[0].mean)) / count
    scatter = np.zeros_like(bins[0].scatter)
    for b in bins:
        away = b.mean - mean
        scatter += b.scatter + b.count * np.multiply.outer(away, away)
    return Average(mean, scatter / ((count - 1) * count), count)


@compiled
def _close(s: ClosedAt, sums: Sums, closed: Closed, row: int, place: int) -> None:
    """Write the open bin into a row of `closed`, and open none."""
    channels, count = len(sums.first), s.count
    at = closed.places[row]
    at.index, at.count, at.place = s.index, count, place
    for c in range(channels):
        closed.mean[row, c] = sums.first[c] + sums.total[c] / count
        closed.low[row, c] = sums.low[c]
        closed.high[row, c] = sums.high[c]
        for r in range(channels):
            products = sums.products[min(r, c), max(r, c)]
            closed.scatter[row, r, c] = products - count * ((sums.total[r] / count) * (sums.total[c] / count))
    s.index = _NONE
    s.count = 0


@compiled
def _fill(
    state: Samples, sums: Sums, stamp_ns: Stamps, values: Array, start: int, length_ns: int, closed: Closed
) -> tuple[int, int]:
    """Take samples from `start` on until the block ends or no room is left for closed bins; their number comes last."""
    s = state[0]
    first, total, low, high, products = sums
    channels = len(first)
    done = 0
    # Where the open bin began and ends; a division for each sample would cost more than its sums.
    begin, end = 0, 0
    if s.index != _NONE:
        begin, end = s.index * length_ns, (s.index + 1) * length_ns
    for i in range(start, len(stamp_ns)):
        if s.index != _NONE and stamp_ns[i] >= end:
            if done == len(closed.places):
                return i, done
            _close(s, sums, closed, done, i)
            done += 1
        finite = True
        for c in range(channels):
            finite = finite and math.isfinite(values[i, c])
        if not finite or (s.index != _NONE and stamp_ns[i] < begin):
            continue
        if s.index == _NONE:
            s.index = stamp_ns[i] // length_ns
            begin, end = s.index * length_ns, (s.index + 1) * length_ns
            for c in range(channels):
                first[c] = low[c] = high[c] = values[i, c]
                total[c] = 0.0
                for r in range(channels):
                    products[r, c] = 0.0
        s.count += 1
        for c in range(channels):
            away = values[i, c] - first[c]
            total[c] += away
            low[c] = min(low[c], values[i, c])
            high[c] = max(high[c], values[i, c])
            # The products are the same either way round.
            for r in range(c + 1):
                products[r, c] += away * (values[i, r] - first[r])
    return len(stamp_ns), done
