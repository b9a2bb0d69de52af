# SPDX-License-Identifier: Apache-2.0
"""
The pace of a replay: which moment of the recording belongs to which moment of the clock on the wall.

Kept apart from clocks and threads: every method takes the time. Due times are counted from one start, so
that errors of single waits never add up.
"""

from __future__ import annotations

import math


class Pace:
    """
    Maps log time to a monotonic clock.

    Parameters
    ----------
    log_ns : int
        Log time at which the replay begins, ns.
    now_s : float
        The monotonic clock at that moment, s.
    rate : float
        Seconds of the recording in a second on the wall; infinity for as fast as possible.

    Raises
    ------
    ValueError
        A rate that is not positive.
    """

    def __init__(self, log_ns: int, now_s: float, rate: float = 1.0) -> None:
        self._log_ns = log_ns
        self._now_s = now_s
        self._rate = _checked(rate)
        self._paused = False

    @property
    def rate(self) -> float:
        """Seconds of the recording in a second on the wall."""
        return self._rate

    @property
    def paused(self) -> bool:
        """Whether time stands still."""
        return self._paused

    def position_ns(self, now_s: float) -> int:
        """Log time reached at a moment on the wall: what /clock says. Stands still while paused."""
        if self._paused or math.isinf(self._rate):
            return self._log_ns
        return self._log_ns + round((now_s - self._now_s) * self._rate * 1e9)

    def due_s(self, log_ns: int) -> float:
        """When on the wall a moment of the recording is due: infinity while paused, the past when it is late."""
        if self._paused:
            return math.inf
        # (x / inf) is 0: as fast as possible, everything is due at the start.
        return self._now_s + (log_ns - self._log_ns) * 1e-9 / self._rate

    def set_rate(self, rate: float, now_s: float) -> None:
        """Go on from here at another rate. Raises ValueError as the constructor."""
        rate = _checked(rate)
        self.seek(self.position_ns(now_s), now_s)
        self._rate = rate

    def pause(self, now_s: float) -> None:
        """Let time stand still."""
        self.seek(self.position_ns(now_s), now_s)
        self._paused = True

    def resume(self, now_s: float) -> None:
        """Let time go on from where it stands."""
        self._paused = False
        self._now_s = now_s

    def seek(self, log_ns: int, now_s: float) -> None:
        """Go on from another moment of the recording; a pause stays one."""
        self._log_ns, self._now_s = log_ns, now_s


def _checked(rate: float) -> float:
    if not rate > 0:
        raise ValueError(f"rate: must be above 0, got {rate!r}")
    return rate
