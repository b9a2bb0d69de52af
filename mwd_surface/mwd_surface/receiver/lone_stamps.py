# SPDX-License-Identifier: Apache-2.0
"""
Wrong stamps of single samples or bursts, and clocks that are set: one wrong stamp must cost one sample only.

If a time differs by more than `STEP_S` from the previous time, the next time decides: the time is right if the next
time follows it, and wrong if the next time is nearer to the previous time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Array

STEP_S = 5.0  #: largest step of time, forward or back, that needs no confirmation, s
#: Longest gap over which a clock is believed to run on, s: no synchronisation with the tool lasts that long.
LONGEST_GAP_S = 3600.0
_MOST = 1e-3  # largest share of lone stamps; a larger share means two interleaved clocks


def lone(times: Array) -> NDArray[np.bool_]:
    """
    Return a mask of the times that are single wrong stamps, shape (n,). The times must be finite.

    A time is lone if it is more than `STEP_S` below or above both of its neighbours, which are in order. The first time
    is lone if it is more than `STEP_S` above the next two, the last time if it is more than `STEP_S` below the two
    before it. The first or last time is also lone if it is more than `LONGEST_GAP_S` away from the others.
    """
    wrong = np.zeros(len(times), dtype=bool)
    if len(times) < 3:
        return wrong
    before, at, after = times[:-2], times[1:-1], times[2:]
    wrong[1:-1] = (before <= after) & ((at < before - STEP_S) | (at > after + STEP_S))
    wrong[0] = times[1] <= times[2] < times[0] - STEP_S or times[1] - times[0] > LONGEST_GAP_S
    wrong[-1] = times[-1] + STEP_S < times[-3] <= times[-2] or times[-1] - times[-2] > LONGEST_GAP_S
    # The first or the last time counts as wrong only if the time next to it is not wrong.
    wrong[0] &= not wrong[1]
    wrong[-1] &= not wrong[-2]
    return wrong if wrong.sum() <= _MOST * len(times) + 1 else np.zeros_like(wrong)


class SteadyTimes:
    """Filter for the times of arriving samples: it drops lone wrong stamps, and runs on where a clock was set."""

    def __init__(self) -> None:
        self._last = -np.inf
        self._ahead = 0.0
        self._unconfirmed: tuple[float, float] | None = None

    def steady(self, time_s: Array, value: Array) -> tuple[Array, Array]:
        """
        Return the samples with confirmed times; the times run on where a clock was set.

        Parameters
        ----------
        time_s, value : ndarray, shape (n,)
            Times, s, and samples.

        Returns
        -------
        time_s, value : ndarray, shape (m,)
            A sample whose time jumps is returned after the next sample has confirmed the jump; a sample whose time is
            not finite is dropped. After a jump back, or forward by more than `LONGEST_GAP_S`, the times continue from
            the last time before the jump.
        """
        time, rows = np.asarray(time_s, dtype=float), np.asarray(value, dtype=float)
        if self._unconfirmed is None and len(time):
            steps = np.diff(time, prepend=self._last if np.isfinite(self._last) else time[0])
            if (np.abs(steps) <= STEP_S).all() and time.min() >= self._last - STEP_S:
                self._last = max(self._last, float(time.max()))
                return time - self._ahead, rows
        pairs = zip(time.tolist(), rows.tolist(), strict=True)
        taken = [pair for at, one in pairs for pair in self._confirmed(at, one)]
        found = np.array(taken, dtype=float).reshape(-1, 2)
        return found[:, 0], found[:, 1]

    def _confirmed(self, at: float, value: float) -> list[tuple[float, float]]:
        """Add a sample, unless its time is not finite; return times and values of the samples now confirmed."""
        if not np.isfinite(at):
            return []
        out, before = [], self._unconfirmed
        if before is not None and abs(at - before[0]) <= abs(at - self._last):
            step = before[0] - self._last
            self._ahead += 0.0 if 0.0 < step <= LONGEST_GAP_S else step
            self._last = before[0]
            out = [(before[0] - self._ahead, before[1])]
        self._unconfirmed = None
        if np.isfinite(self._last) and abs(at - self._last) > STEP_S:
            self._unconfirmed = (at, value)
            return out
        self._last = max(self._last, at)
        return [*out, (at - self._ahead, value)]
