# SPDX-License-Identifier: Apache-2.0
"""Status of the attitude at the end of each bin, for surveys that are complete only later."""

from __future__ import annotations

import collections

from mwd_sensors.core.arrays import Samples

# Bins kept: longer than a survey waits for the gyro.
_KEPT = 1200
_SLACK_NS = 1_000_000  # a survey's ends are rounded to less


class StatusHistory:
    """What the attitude's status was, however the stream is cut into blocks; bin_ns: length of a bin."""

    def __init__(self, bin_ns: int) -> None:
        self._bin_ns = bin_ns
        self._last = 0
        self._kept: collections.deque[tuple[int, int]] = collections.deque(maxlen=_KEPT)

    def add(self, status: Samples, bins: list[tuple[int, int]]) -> None:
        """
        Take the status of the rows of a block.

        bins: of each bin that the row at a place brought to its end: that place, and the end of the bin before, ns.
        """
        for place, end_ns in bins:
            # The row before belongs to the bin.
            self._kept.append((end_ns + self._bin_ns, int(status[place - 1]) if place else self._last))
        if len(status):
            self._last = int(status[-1])

    def at(self, end_ns: int) -> int:
        """Status of the last row of the bin that ends at a time, or of the last one before it."""
        for known_ns, status in reversed(self._kept):
            if known_ns <= end_ns + _SLACK_NS:
                return status
        return self._last
