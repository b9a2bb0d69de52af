# SPDX-License-Identifier: Apache-2.0
"""
The pace of a replay: conversion between the time of the recording and the wall clock.

No method reads a clock: the caller passes the time. Due times are counted from one start, so that the errors of single
waits never add up.
"""

from __future__ import annotations

import math


class Pace:
    """
    Conversion of log time to a monotonic clock.

    Parameters
    ----------
    log_ns : int
        Log time at which the replay begins.
    now_s : float
        Reading of the monotonic clock when the replay begins.
    rate : float
        Seconds of the recording per second of wall time; infinity: as fast as possible.

    Raises
    ------
    ValueError
        The rate is not positive.
    """

    def __init__(self, log_ns: int, now_s: float, rate: float = 1.0) -> None:
        self._log_ns = log_ns
        self._now_s = now_s
        self._rate = _checked(rate)
        self._paused = False

    @property
    def rate(self) -> float:
        """Seconds of the recording per second of wall time."""
        return self._rate

    @property
    def paused(self) -> bool:
        """Whether the replay is paused."""
        return self._paused

    def position_ns(self, now_s: float) -> int:
        """
        Return the log time, ns, that the replay has reached at a wall time, as published on /clock.

        The log time does not advance while the replay is paused or has an infinite rate.
        """
        if self._paused or math.isinf(self._rate):
            return self._log_ns
        return self._log_ns + round((now_s - self._now_s) * self._rate * 1e9)

    def due_s(self, log_ns: int) -> float:
        """Return the wall time, s, at which a log time is due: infinity while paused, a past time if overdue."""
        if self._paused:
            return math.inf
        # x / inf is 0: at the rate "as fast as possible" everything is due at the start.
        return self._now_s + (log_ns - self._log_ns) * 1e-9 / self._rate

    def set_rate(self, rate: float, now_s: float) -> None:
        """Continue from the present log time at another rate. Raises ValueError like the constructor."""
        rate = _checked(rate)
        self.seek(self.position_ns(now_s), now_s)
        self._rate = rate

    def pause(self, now_s: float) -> None:
        """Pause the replay at the log time that the replay has reached; now_s: monotonic clock."""
        self.seek(self.position_ns(now_s), now_s)
        self._paused = True

    def resume(self, now_s: float) -> None:
        """Continue from the log time at which the replay was paused; now_s: monotonic clock."""
        self._paused = False
        self._now_s = now_s

    def seek(self, log_ns: int, now_s: float) -> None:
        """Continue from another log time, ns; a paused replay stays paused. now_s: monotonic clock."""
        self._log_ns, self._now_s = log_ns, now_s


def _checked(rate: float) -> float:
    if not rate > 0:
        raise ValueError(f"rate: must be above 0, got {rate!r}")
    return rate
