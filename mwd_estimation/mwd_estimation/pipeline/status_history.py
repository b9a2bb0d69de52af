# SPDX-License-Identifier: Apache-2.0
"""Status of the attitude at the end of each bin, for surveys that are completed later."""

from __future__ import annotations

import collections

from mwd_sensors.core.arrays import Samples

# Number of bins kept: longer than a survey waits for the gyro.
_KEPT = 1200
_SLACK_NS = 1_000_000  # the ends of a survey are rounded to less than this


class StatusHistory:
    """History of the attitude's status, independent of how the stream is cut; bin_ns : length of a bin, ns."""

    def __init__(self, bin_ns: int) -> None:
        self._bin_ns = bin_ns
        self._last = 0
        self._kept: collections.deque[tuple[int, int]] = collections.deque(maxlen=_KEPT)

    def add(self, status: Samples, bins: list[tuple[int, int]]) -> None:
        """
        Add the status of the rows of a block.

        bins : for each bin that ends in the block: the row that ended it, and the end of the bin before, ns.
        """
        for place, end_ns in bins:
            # The row before the ending row belongs to the bin.
            self._kept.append((end_ns + self._bin_ns, int(status[place - 1]) if place else self._last))
        if len(status):
            self._last = int(status[-1])

    def at(self, end_ns: int) -> int:
        """Return the status of the last row in the bin that ends at a time, or of the last earlier row."""
        for known_ns, status in reversed(self._kept):
            if known_ns <= end_ns + _SLACK_NS:
                return status
        return self._last
