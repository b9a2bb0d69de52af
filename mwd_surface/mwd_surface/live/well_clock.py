# SPDX-License-Identifier: Apache-2.0
"""
The time of a well: set by whoever feeds the well, read by its parts.

It runs with the arrival of messages, which is the log time of a recording: the live node sets it by its own steady
clock, the viewer of a recording by that of the recording. Nothing in this room reads a clock of the machine.
"""

from __future__ import annotations

from mwd_sensors.core.wire import NANOSECONDS

_DAY_NS = 86_400 * NANOSECONDS


class WellClock:
    """
    Time of one well.

    Parameters
    ----------
    begin_ns : int
        Time since the epoch at which it begins, ns.

    Attributes
    ----------
    now_ns : int
        Time since the epoch, ns.
    origin_ns : int
        The midnight (UTC) before the begin, from which `now` counts: two readers of the same messages count alike.
    """

    def __init__(self, begin_ns: int = 0) -> None:
        self.now_ns = begin_ns
        self.origin_ns = begin_ns - begin_ns % _DAY_NS

    @property
    def now(self) -> float:
        """Time since the origin, s."""
        return self.seconds(self.now_ns)

    def seconds(self, time_ns: int) -> float:
        """Return a time since the epoch, ns, as s since the origin."""
        return (time_ns - self.origin_ns) / NANOSECONDS
