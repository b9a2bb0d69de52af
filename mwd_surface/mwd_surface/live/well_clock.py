# SPDX-License-Identifier: Apache-2.0
"""
Time of a well: set by the node or viewer that passes the messages, read by the parts of the well.

The time is that of the arrival of messages, which is the log time of a recording. The live node sets the time from its
own steady clock, the viewer of a recording from the log times. No module of this package reads a clock of the machine.
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
        Time of the start, ns since the epoch.
    """

    def __init__(self, begin_ns: int = 0) -> None:
        self.now_ns = begin_ns  #: present time, ns since the epoch
        #: Origin of `now`, ns since the epoch: the midnight (UTC) before the start, so that two readers of the same
        #: messages have the same `now`.
        self.origin_ns = begin_ns - begin_ns % _DAY_NS

    @property
    def now(self) -> float:
        """Time since the origin, s."""
        return self.seconds(self.now_ns)

    def seconds(self, time_ns: int) -> float:
        """Return a time since the epoch, ns, as s since the origin."""
        return (time_ns - self.origin_ns) / NANOSECONDS
