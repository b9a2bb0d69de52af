"""
Sums over equal bins of time: what surveys are averaged from, in constant memory.

A stream is cut at multiples of the bin length since the epoch, so that the same messages fall into the same bins
however they arrive. Within a bin, sums are taken in order and about the bin's first sample, so that any cut of the
stream into blocks gives the same bits and a variance loses no digits.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.compiled import compiled

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

_NONE = np.iinfo(np.int64).min
_LARGEST = 1e6  # no sensor reads that in its SI unit; squares of it still leave all digits of the others


@dataclasses.dataclass(frozen=True)
class Bin:
    """
    One closed bin of a stream with c channels.

    Attributes
    ----------
    index : int
        Start of the bin over its length, both in ns since the epoch.
    count : int
        Samples in it.
    mean : ndarray, shape (c,)
        In the channels' units.
    scatter : ndarray, shape (c, c)
        Sum of outer products about the mean, in the units' squares.
    low, high : ndarray, shape (c,)
        Extremes.
    """

    index: int
    count: int
    mean: Array
    scatter: Array
    low: Array
    high: Array


@dataclasses.dataclass(frozen=True)
class Average:
    """Mean, shape (c,), covariance of the mean, shape (c, c), and number of samples of several bins together."""

    mean: Array
    covariance: Array
    count: int


class Binner:
    """
    Cuts one stream into bins.

    Parameters
    ----------
    channels : int
        Values per sample.
    length_ns : int
        Of a bin.
    """

    def __init__(self, channels: int, length_ns: int) -> None:
        self.length_ns = length_ns
        self.newest_ns = _NONE
        self._counts = np.array([_NONE, 0], dtype=np.int64)
        # Rows: first sample, sum, lowest, highest; then the sums of products, row by row.
        self._sums = np.zeros((4 + channels, channels))

    def add(self, stamp_ns: Stamps, values: Array) -> list[Bin]:
        """
        Take a block, shapes (n,) and (n, channels); give the bins that it closed.

        Samples that are not finite, absurdly large or older than the open bin are left out. A bin closes with the
        first sample of a later one.
        """
        closed: list[Bin] = []
        start, n = 0, len(stamp_ns)
        if n:
            self.newest_ns = max(self.newest_ns, int(stamp_ns[-1]))
        while start < n:
            start = _fill(self._counts, self._sums, stamp_ns, values, start, self.length_ns)
            if start < n:
                closed.append(self._close())
        return closed

    def flush(self, before_ns: int) -> list[Bin]:
        """Close the open bin where the stream fell silent and the bin ends before that time, ns."""
        index = int(self._counts[0])
        if index == _NONE or (index + 1) * self.length_ns > before_ns:
            return []
        return [self._close()]

    def _close(self) -> Bin:
        index, count = (int(v) for v in self._counts)
        first, total = self._sums[0], self._sums[1]
        mean = total / count
        closed = Bin(
            index,
            count,
            first + mean,
            self._sums[4:] - count * np.multiply.outer(mean, mean),
            self._sums[2].copy(),
            self._sums[3].copy(),
        )
        self._counts[:] = (_NONE, 0)
        return closed


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
def _fill(counts: Stamps, sums: Array, stamp_ns: Stamps, values: Array, start: int, length_ns: int) -> int:
    """Fill the open bin from sample `start` on; return the first sample that belongs to a later bin, or the end."""
    channels = sums.shape[1]
    for i in range(start, len(stamp_ns)):
        index = stamp_ns[i] // length_ns
        if counts[0] != _NONE and index > counts[0]:
            return i
        finite = True
        for c in range(channels):
            finite = finite and abs(values[i, c]) < _LARGEST
        if not finite or (counts[0] != _NONE and index < counts[0]):
            continue
        if counts[0] == _NONE:
            counts[0] = index
            for c in range(channels):
                sums[0, c] = sums[2, c] = sums[3, c] = values[i, c]
                for r in range(channels):
                    sums[4 + r, c] = 0.0
                sums[1, c] = 0.0
        counts[1] += 1
        for c in range(channels):
            away = values[i, c] - sums[0, c]
            sums[1, c] += away
            sums[2, c] = min(sums[2, c], values[i, c])
            sums[3, c] = max(sums[3, c], values[i, c])
            for r in range(channels):
                sums[4 + r, c] += away * (values[i, r] - sums[0, r])
    return len(stamp_ns)
