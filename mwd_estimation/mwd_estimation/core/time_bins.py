# SPDX-License-Identifier: Apache-2.0
"""
Sums over equal time bins, from which surveys are averaged in constant memory.

A stream is cut at multiples of the bin length since the epoch, so that the same samples always fall into the same bins.
Within a bin, samples are added in order, relative to the first sample of the bin. Thus the result does not depend, even
in the last bit, on how the stream is cut into blocks, and the variance loses no digits.
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
_ROOM = 64  # number of bins that one call of the kernel can close


@dataclasses.dataclass(frozen=True)
class Bin:
    """One closed bin of a stream with c channels."""

    index: int  #: start of the bin divided by its length, both in ns since the epoch
    count: int  #: number of samples in the bin
    mean: Array  #: shape (c,), in the units of the channels
    scatter: Array  #: shape (c, c); sum of outer products of the deviations from the mean, in the units squared
    #: `low`, `high`: shape (c,); smallest and largest value.
    low: Array
    high: Array


@dataclasses.dataclass(frozen=True)
class Average:
    """Average of several bins: mean, shape (c,), covariance of the mean, shape (c, c), and number of samples."""

    mean: Array
    covariance: Array
    count: int


class ClosedAt:
    """Index and count of a bin, and the sample that closed it."""

    #: `index`, `count`: see `Bin`; index is _NONE if no bin is open.
    index: int
    count: int
    place: int  #: index in the block of the sample that closed the bin


_CLOSED_AT = dtype_of(ClosedAt)


class OpenBinSums(NamedTuple):
    """
    Sums of the open bin.

    `first`: first sample; `total`: sum of the differences from it; `low`, `high`: smallest and largest value; each of
    shape (c,). `products`: sum of the products of the differences, upper triangle, shape (c, c).
    """

    first: Array
    total: Array
    low: Array
    high: Array
    products: Array


class Closed(NamedTuple):
    """
    Bins closed in one call of the kernel.

    `places`: records of `ClosedAt`, shape (k,); the others as in `Bin`, with shapes (k, c) and (k, c, c).
    """

    places: Samples
    mean: Array
    low: Array
    high: Array
    scatter: Array


class Binner:
    """Sums of the samples of a stream in bins of `length_ns`, ns; channels: number of values of each sample."""

    def __init__(self, channels: int, length_ns: int) -> None:
        self.length_ns = length_ns
        self._open = np.zeros(1, _CLOSED_AT)
        self._open["index"] = _NONE
        first, total, low, high = np.zeros((4, channels))
        self._sums = OpenBinSums(first, total, low, high, np.zeros((channels, channels)))
        mean, lowest, highest = np.zeros((3, _ROOM, channels))
        self._closed = Closed(np.zeros(_ROOM, _CLOSED_AT), mean, lowest, highest, np.zeros((_ROOM, channels, channels)))

    def add(self, stamp_ns: Stamps, values: Array) -> list[Bin]:
        """
        Add a block, stamps (ns) of shape (n,) and values of shape (n, channels); return the bins that the block closed.

        Samples that are not finite or are older than the open bin are ignored. The first sample of a later bin closes
        the open one.
        """
        return [closed for closed, _ in self.add_placed(stamp_ns, values)]

    def add_placed(self, stamp_ns: Stamps, values: Array) -> list[tuple[Bin, int]]:
        """Add a block as `add` does; return each closed bin and the index in the block of the sample that closed it."""
        closed: list[tuple[Bin, int]] = []
        start, n = 0, len(stamp_ns)
        while start < n:
            start, count = _fill(self._open, self._sums, stamp_ns, values, start, self.length_ns, self._closed)
            if count:
                closed += self._bins(count)
        return closed

    def flush(self, before_ns: int) -> list[Bin]:
        """Close and return the open bin if it ends by a time, ns, else an empty list; for a stream that has stopped."""
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
    Return the mean of all samples in the bins, and its covariance from the scatter of these samples.

    Raises
    ------
    ValueError
        If there are fewer than two samples.
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
def _close(s: ClosedAt, sums: OpenBinSums, closed: Closed, row: int, place: int) -> None:
    """Write the open bin into a row of `closed`, and mark that no bin is open."""
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
    state: Samples, sums: OpenBinSums, stamp_ns: Stamps, values: Array, start: int, length_ns: int, closed: Closed
) -> tuple[int, int]:
    """
    Add the samples from index `start` on; stop if `closed` is full.

    stamp_ns, values: as in `Binner.add`; length_ns: length of a bin. Returns the index of the first sample not
    added, and the number of closed bins.
    """
    s = state[0]
    first, total, low, high, products = sums
    channels = len(first)
    done = 0
    # Start and end of the open bin, ns, computed once a bin: a division for each sample would cost more than the sums.
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
            # The matrix is symmetric, so half of it is enough.
            for r in range(c + 1):
                products[r, c] += away * (values[i, r] - first[r])
    return len(stamp_ns), done
