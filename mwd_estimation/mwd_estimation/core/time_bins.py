"""
Sums over equal bins of time: what surveys are averaged from, in constant memory.

A stream is cut at multiples of the bin length since the epoch, so that the same messages fall into the same bins
however they arrive. Within a bin, sums are taken in order and about the bin's first sample, so that any cut of the
stream into blocks gives the same bits and a variance loses no digits.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.core.compiled import compiled

_NONE = np.iinfo(np.int64).min
_ROOM = 64  # bins that one call of the kernel can close
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
        self._counts = np.array([_NONE, 0], dtype=np.int64)
        # Rows: first sample, sum, lowest, highest; then the sums of products, row by row.
        self._sums = np.zeros((4 + channels, channels))
        # Closed bins of one call of the kernel: index, count and place; mean, lowest, highest and scatter.
        self._done = np.zeros((_ROOM, 3), dtype=np.int64)
        self._figures = np.zeros((_ROOM, 3 + channels, channels))

    def add(self, stamp_ns: Stamps, values: Array) -> list[Bin]:
        """
        Take a block, shapes (n,) and (n, channels); give the bins that it closed.

        Samples that are not finite, absurdly large or older than the open bin are left out. A bin closes with the
        first sample of a later one.
        """
        return [closed for closed, _ in self.add_placed(stamp_ns, values)]

    def add_placed(self, stamp_ns: Stamps, values: Array) -> list[tuple[Bin, int]]:
        """As `add`, and with each bin the place in the block of the sample that closed it."""
        closed: list[tuple[Bin, int]] = []
        start, n = 0, len(stamp_ns)
        while start < n:
            start, count = _fill(
                self._counts, self._sums, stamp_ns, values, start, self.length_ns, self._done, self._figures
            )
            if count:
                closed += self._bins(count)
        return closed

    def flush(self, before_ns: int) -> list[Bin]:
        """Close the open bin where the stream fell silent and the bin ends before that time, ns."""
        index = int(self._counts[0])
        if index == _NONE or (index + 1) * self.length_ns > before_ns:
            return []
        _close(self._counts, self._sums, self._done, self._figures, 0, 0)
        return [closed for closed, _ in self._bins(1)]

    def _bins(self, count: int) -> list[tuple[Bin, int]]:
        figures = self._figures[:count].copy()
        return [
            (Bin(index, size, part[0], part[3:], part[1], part[2]), place)
            for (index, size, place), part in zip(self._done[:count].tolist(), figures, strict=True)
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
def _close(counts: Stamps, sums: Array, done: Stamps, figures: Array, row: int, place: int) -> None:
    """Write the open bin into a row of `done` and `figures`, and open none."""
    channels = sums.shape[1]
    count = counts[1]
    done[row, 0], done[row, 1], done[row, 2] = counts[0], count, place
    for c in range(channels):
        figures[row, 0, c] = sums[0, c] + sums[1, c] / count
        figures[row, 1, c] = sums[2, c]
        figures[row, 2, c] = sums[3, c]
        for r in range(channels):
            products = sums[4 + min(r, c), max(r, c)]
            figures[row, 3 + r, c] = products - count * ((sums[1, r] / count) * (sums[1, c] / count))
    counts[0] = _NONE
    counts[1] = 0


@compiled
def _fill(
    counts: Stamps,
    sums: Array,
    stamp_ns: Stamps,
    values: Array,
    start: int,
    length_ns: int,
    done: Stamps,
    figures: Array,
) -> tuple[int, int]:
    """Take samples from `start` on until the block ends or no room is left for closed bins; their number comes last."""
    channels = sums.shape[1]
    closed = 0
    # Where the open bin began and ends; a division for each sample would cost more than its sums.
    begin, end = 0, 0
    if counts[0] != _NONE:
        begin, end = counts[0] * length_ns, (counts[0] + 1) * length_ns
    for i in range(start, len(stamp_ns)):
        if counts[0] != _NONE and stamp_ns[i] >= end:
            if closed == len(done):
                return i, closed
            _close(counts, sums, done, figures, closed, i)
            closed += 1
        finite = True
        for c in range(channels):
            finite = finite and abs(values[i, c]) < _LARGEST
        if not finite or (counts[0] != _NONE and stamp_ns[i] < begin):
            continue
        if counts[0] == _NONE:
            counts[0] = stamp_ns[i] // length_ns
            begin, end = counts[0] * length_ns, (counts[0] + 1) * length_ns
            for c in range(channels):
                sums[0, c] = sums[2, c] = sums[3, c] = values[i, c]
                sums[1, c] = 0.0
                for r in range(channels):
                    sums[4 + r, c] = 0.0
        counts[1] += 1
        for c in range(channels):
            away = values[i, c] - sums[0, c]
            sums[1, c] += away
            sums[2, c] = min(sums[2, c], values[i, c])
            sums[3, c] = max(sums[3, c], values[i, c])
            # The products are the same either way round.
            for r in range(c + 1):
                sums[4 + r, c] += away * (values[i, r] - sums[0, r])
    return len(stamp_ns), closed
