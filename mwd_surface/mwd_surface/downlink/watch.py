# SPDX-License-Identifier: Apache-2.0
"""Detector of operator input: flow or rotation that differs from the downlink's set-point."""

from __future__ import annotations

from collections import deque

_HELD_S = 2.0


class DeviationWatch:
    """
    Comparison of the rig's readings with the set-points.

    Parameters
    ----------
    base : float
        Drilling value of the quantity that the downlink changes.
    other : float or None
        Initial value of the quantity that it does not change; None: unknown.
    margins : (float, float)
        Allowed deviation of the changed and of the unchanged quantity.
    lag_s : float
        Longest delay with which the rig follows a set-point.
    """

    def __init__(self, base: float, other: float | None, margins: tuple[float, float], lag_s: float) -> None:
        self._other, self._lag = other, lag_s
        self._margin, self._other_margin = margins
        self._asked: deque[tuple[float, float]] = deque([(-lag_s, base)])
        self._off_since: float | None = None

    def take(self, now: float, asked: float, value: float | None, other: float | None) -> bool:
        """
        Add set-point and readings at a steady time, s; return whether they have differed for 2 s.

        asked, value: set-point and reading of the quantity that the downlink changes. other: reading of the unchanged
        one.
        """
        self._asked.append((now, asked))
        # Keep the last set-point before the delay: the rig may still be following it.
        while len(self._asked) > 1 and self._asked[1][0] < now - self._lag:
            self._asked.popleft()
        recent = [one for _, one in self._asked]
        off = value is not None and not min(recent) - self._margin <= value <= max(recent) + self._margin
        if self._other is not None and other is not None:
            off = off or abs(other - self._other) > self._other_margin
        if not off:
            self._off_since = None
            return False
        self._off_since = now if self._off_since is None else self._off_since
        return now - self._off_since >= _HELD_S
