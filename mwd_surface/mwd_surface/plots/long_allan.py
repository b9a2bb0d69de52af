# SPDX-License-Identifier: Apache-2.0
"""
Allan deviation of a record of any length, in constant memory.

The first part is kept unchanged and gives the short averaging times if it contains enough averages; the whole record is
kept as means of an increasing number of samples and gives the long ones. A record that fits gives exactly
`mwd_sensors.calibration.allan.allan`.
"""

from __future__ import annotations

import numpy as np

from mwd_sensors.calibration.allan import AllanCurve, allan
from mwd_sensors.core.arrays import Array

# Averaging times below this number of kept means are taken from the first part.
_FROM_MEANS = 16


class LongAllan:
    """
    Collects a record; `curve` gives its overlapping Allan deviation.

    Parameters
    ----------
    rate : float
        Sampling rate, Hz.
    columns : int
    capacity : int
        Number of samples kept; even, at least 64.

    Raises
    ------
    ValueError
        The capacity is odd or below 64.
    """

    def __init__(self, rate: float, columns: int, capacity: int = 1 << 18) -> None:
        if capacity < 64 or capacity % 2:
            raise ValueError(f"capacity must be even and at least 64, got {capacity}")
        self.rate, self.samples = rate, 0
        self._kept = np.empty((capacity, columns))
        self._count, self._ratio = 0, 1
        self._left = np.empty((0, columns))
        self._short: AllanCurve | None = None

    def add(self, values: Array) -> None:
        """Add samples, shape (n, columns), equally spaced and at rest."""
        self.samples += len(values)
        pending = np.concatenate([self._left, values])
        self._left = pending[:0]
        while len(pending):
            if self._count == len(self._kept):
                self._halve()
            whole = min(len(pending) // self._ratio, len(self._kept) - self._count)
            if whole == 0:
                self._left = pending
                return
            taken, pending = pending[: whole * self._ratio], pending[whole * self._ratio :]
            means = taken.reshape(whole, self._ratio, -1).mean(axis=1)
            self._kept[self._count : self._count + whole] = means
            self._count += whole

    def curve(self) -> AllanCurve:
        """
        Return the deviation over averaging times up to a fifth of the record; its axes are the columns.

        Raises
        ------
        ValueError
            Fewer than 20 samples, or samples that are not finite.
        """
        long = allan(self._kept[: self._count], self.rate / self._ratio)
        if self._short is None:
            return long
        limit = _FROM_MEANS * self._ratio / self.rate
        early, late = self._short.tau < limit, long.tau >= limit
        return AllanCurve(
            np.concatenate([self._short.tau[early], long.tau[late]]),
            np.concatenate([self._short.deviation[early], long.deviation[late]]),
            np.concatenate([self._short.sigma[early], long.sigma[late]]),
        )

    def _halve(self) -> None:
        if self._short is None:
            self._short = allan(self._kept, self.rate)
        half = self._count // 2
        self._kept[:half] = 0.5 * (self._kept[0 : self._count : 2] + self._kept[1 : self._count : 2])
        self._count = half
        self._ratio *= 2
