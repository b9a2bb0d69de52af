# SPDX-License-Identifier: Apache-2.0
"""
Commands from the surface, found in the tool's own rotation or flow.

The signal is averaged in cells of 0.2 s and smoothed over a hold with a triangle: two means over half a hold, one after
the other, so that an oscillation whose period is half a hold (stick-slip) is left out twice. At every cell the smoothed
signal one symbol apart is compared with the start of a command: drilling value, lowest level, drilling value. Where
that fits, the nine levels between are read on the scale of these three, and count if they lie near whole levels and
the check holds. All sums are of whole numbers, so that the result does not depend on how the samples are cut.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Stamps
from mwd_sensors.telemetry.downlink import HEAD, LEVELS, TAIL, Downlink, Frame, decode

_CELL_NS = 200_000_000
_DATA = 9
_SAMPLES = len(HEAD) + _DATA + len(TAIL)
# Signal as whole numbers: 1e-6 rad/s or 1e-9 m^3/s, far below any sensor's noise.
_SCALE = {"rotation": 1e6, "flow": 1e9}
# The drop to the lowest level over what the tool configuration says. Gauges and slipping strings are not exact.
_DROP = (0.6, 1.5)
# Drilling values of one command differ by less than this share of the drop; more would be another step of the scale.
_STEADY = 1.0 / (2.0 * (LEVELS - 1))
# Distance of the levels read from whole ones: root mean square, and each. Any values would be 0.29 away on average.
_RMS, _MOST = 0.2, 0.42
# Longest time without samples, cells; beyond it the signal begins anew.
_GAP = 10


class Received(NamedTuple):
    """A command, and the stamp of its end, ns."""

    frame: Frame
    stamp_ns: int


class DownlinkDecoder:
    """Finds commands in a stream of samples."""

    def __init__(self, downlink: Downlink) -> None:
        self._downlink, self._scale = downlink, _SCALE[downlink.medium]
        cell_s = _CELL_NS * 1e-9
        self._half = max(round(0.5 * downlink.hold_s / cell_s), 1)
        places = [round(k * downlink.symbol_s / cell_s) for k in range(_SAMPLES)]
        self._places = [place - places[-1] - 1 for place in places]
        # The best fit comes within this time of the first one.
        self._settle = max(round(0.5 * downlink.symbol_s / cell_s), 1)
        self._begin()

    @property
    def delay_ns(self) -> int:
        """Longest time from the end of a command to its being known, ns."""
        return (self._settle + 2) * _CELL_NS

    def _begin(self) -> None:
        self._cell: int | None = None
        self._sum = self._count = self._value = 0
        self._once = self._twice = 0
        self._history: deque[int] = deque([0] * (2 * self._half + 1), maxlen=2 * self._half + 1)
        self._smooth: deque[float] = deque(maxlen=-self._places[0])
        self._skip = 2 * self._half
        self._best: tuple[float, Received] | None = None
        self._wait = 0

    def push(self, stamp_ns: Stamps, signal: Array) -> list[Received]:
        """
        Take samples in order of time and give the commands that ended.

        stamp_ns, shape (n,): ns. signal, shape (n,): rotation about the axis, rad/s, or flow, m^3/s; what is not
        finite is left out.
        """
        known = np.isfinite(signal)
        cells = stamp_ns[known] // _CELL_NS
        if not len(cells):
            return []
        whole = np.round(signal[known] * self._scale).astype(np.int64)
        starts = np.concatenate([[0], np.flatnonzero(np.diff(cells)) + 1])
        found: list[Received] = []
        counts = np.diff(np.append(starts, len(cells)))
        for cell, total, count in zip(cells[starts], np.add.reduceat(whole, starts), counts, strict=True):
            found += self._take(int(cell), int(total), int(count))
        return found

    def _take(self, cell: int, total: int, count: int) -> list[Received]:
        """Take what a cell holds, perhaps not all of it yet."""
        found: list[Received] = []
        if self._cell is not None and not 0 <= cell - self._cell <= _GAP:
            self._begin()
        if self._cell is not None and cell > self._cell:
            self._value = self._sum // self._count
            for k in range(self._cell, cell):
                found += self._close(k)
            self._sum = self._count = 0
        self._cell = cell
        self._sum += total
        self._count += count
        return found

    def _close(self, cell: int) -> list[Received]:
        """Smooth the signal up to a cell, and look for a command that ends with it."""
        half, history = self._half, self._history
        self._once += self._value
        self._twice += self._once
        history.append(self._twice)
        if self._skip:
            self._skip -= 1
            return []
        self._smooth.append((history[-1] - 2 * history[half] + history[0]) / (half * half * self._scale))
        if len(self._smooth) == self._smooth.maxlen:
            fit = self._fit(cell)
            if fit is not None and (self._best is None or fit[0] < self._best[0]):
                self._wait = self._wait if self._best is not None else self._settle
                self._best = fit
        if self._best is None:
            return []
        if self._wait:
            self._wait -= 1
            return []
        received, self._best = self._best[1], None
        self._smooth.clear()
        return [received]

    def _fit(self, cell: int) -> tuple[float, Received] | None:
        """Distance from whole levels and the command that ends with this cell, if there is one."""
        smooth, places, downlink = self._smooth, self._places, self._downlink
        first, low, second, last = (smooth[places[k]] for k in (0, 1, 2, -1))
        high = (first + second + last) / 3.0
        drop = high - low
        expected = downlink.depth * high
        if high < downlink.least_value or not _DROP[0] * expected < drop < _DROP[1] * expected:
            return None
        if max(first, second, last) - min(first, second, last) > _STEADY * drop:
            return None
        read = [(smooth[places[len(HEAD) + k]] - low) / drop * (LEVELS - 1) for k in range(_DATA)]
        whole = [min(max(round(one), 0), LEVELS - 1) for one in read]
        off = [abs(one - level) for one, level in zip(read, whole, strict=True)]
        rms = (sum(one * one for one in off) / _DATA) ** 0.5
        if rms > _RMS or max(off) > _MOST:
            return None
        frame = decode(tuple(whole), downlink)
        return None if frame is None else (rms, Received(frame, (cell + 1) * _CELL_NS))
