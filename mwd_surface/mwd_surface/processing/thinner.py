# SPDX-License-Identifier: Apache-2.0
"""Reduction of a fast stream to the first row in each interval of equal length, independent of the block boundaries."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Thinner:
    """
    Selector of rows of streams by their stamps.

    rate_hz : largest number of rows per second; 0 keeps every row.
    """

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz) if rate_hz > 0.0 else 0
        self._last = -1

    def __call__(self, stamp_ns: NDArray[np.int64]) -> slice | NDArray[np.bool_]:
        """Return which rows of a block to keep, by their stamps, shape (n,), ns: the first of each period, or all."""
        if self._period_ns <= 0 or not len(stamp_ns):
            return slice(None)
        intervals = stamp_ns // self._period_ns
        picked: NDArray[np.bool_] = np.diff(intervals, prepend=self._last) != 0
        self._last = int(intervals[-1])
        return picked
