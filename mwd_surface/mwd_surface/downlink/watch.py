# SPDX-License-Identifier: Apache-2.0
"""Operator input: flow or rotation that is not what the downlink asked for."""

from __future__ import annotations

from collections import deque

_HELD_S = 2.0


class DeviationWatch:
    """
    Compares what the rig does with what was asked.

    Parameters
    ----------
    base : float
        Drilling value of what the downlink changes.
    other : float or None
        Value at the start of what it does not change; None: unknown.
    margins : (float, float)
        Deviation of the one and of the other that gauges may show.
    lag_s : float
        Longest time after which the rig follows a set-point.
    """

    def __init__(self, base: float, other: float | None, margins: tuple[float, float], lag_s: float) -> None:
        self._other, self._lag = other, lag_s
        self._margin, self._other_margin = margins
        self._asked: deque[tuple[float, float]] = deque([(-lag_s, base)])
        self._off_since: float | None = None

    def take(self, now: float, asked: float, value: float | None, other: float | None) -> bool:
        """
        Take set-point and readings at a steady time, s; returns whether they have differed for 2 s.

        asked, value : of what the downlink changes. other : of what it does not change.
        """
        self._asked.append((now, asked))
        # The last one before the lag still counts: it is what the rig may be following.
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
