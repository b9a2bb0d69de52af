# SPDX-License-Identifier: Apache-2.0
"""One link fed with bursts as they arrive: stamps become times since the first sample, pressure waits for strokes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.following_link import FollowingLink
from mwd_surface.receiver.link import Link, LinkOutput
from mwd_surface.receiver.link_attitude import AgeRules

_BACK_S = 5.0
_LONGEST_GAP_S = 3600.0  # a longer one begins anew: no sync outlives it, and filling it would take seconds
# Pressure waits so long, s of its own time, for the strokes up to its end; a counter that failed is waited for no more.
_WAIT_S = 10.0


class LinkFeed:
    """
    One link and the clock of its samples.

    Parameters
    ----------
    tool : ToolConfiguration
        As in the tool.
    rules : AgeRules
    warn : callable
        Called with a sentence where the link begins anew.

    Attributes
    ----------
    tool, in_force : ToolConfiguration
        As configured, and as a downlink has changed it.
    following : FollowingLink
    """

    def __init__(self, tool: ToolConfiguration, rules: AgeRules, warn: Callable[[str], None]) -> None:
        self.tool, self.in_force, self._rules, self._warn = tool, tool, rules, warn
        self._begin()

    def _begin(self) -> None:
        self._origin_ns: int | None = None
        self._strokes_until: int | None = None
        self._waiting: deque[tuple[int, float, Array]] = deque()
        self.following = FollowingLink(Link(self.in_force, self.tool.link, self._rules, self.stamp_of))

    @property
    def link(self) -> Link:
        """Link in force."""
        return self.following.link

    def stamp_of(self, seconds: float) -> int:
        """Stamp, ns, of a time on the clock of the samples, s."""
        return (self._origin_ns or 0) + round(seconds * NANOSECONDS)

    def seconds(self, stamp_ns: int) -> float | None:
        """Time on the clock of the samples, s, of a stamp; None before the first sample."""
        return None if self._origin_ns is None else (stamp_ns - self._origin_ns) / NANOSECONDS

    def push(self, start_ns: int, period_s: float, values: Array) -> LinkOutput:
        """
        Take a burst: stamp of its first sample, ns, time between samples, s, and samples, shape (n,).

        A time that goes back, or on by more than an hour, begins the link anew.
        """
        if self._origin_ns is None:
            self._origin_ns = start_ns
        newest = self._waiting[-1][0] if self._waiting else self.stamp_of(self.link.now_s) if self.heard else None
        if newest is not None:
            ahead = (start_ns - newest) / NANOSECONDS
            back = ahead + period_s * len(values) < -_BACK_S
            if back or ahead > _LONGEST_GAP_S:
                self._warn(f"the time went {'back by more than 5 s' if back else 'on by more than an hour'}")
                self._begin()
                self._origin_ns = start_ns
        self._waiting.append((start_ns, period_s, values))
        return self._advance()

    @property
    def heard(self) -> bool:
        """Whether any sample has reached the link."""
        return math.isfinite(self.link.now_s)

    def take_strokes(self, until_ns: int, strokes: Sequence[tuple[int, int]]) -> LinkOutput:
        """Take strokes of pumps: pump and stamp, ns, of each; until_ns: up to which there are no others."""
        if self._origin_ns is None:
            return LinkOutput()
        for pump in sorted({pump for pump, _ in strokes}):
            times = [(at - self._origin_ns) / NANOSECONDS for one, at in strokes if one == pump]
            self.following.take_strokes(pump, np.array(times))
        self._strokes_until = until_ns
        return self._advance()

    def finish(self) -> LinkOutput:
        """Give what is left when no more samples come."""
        out = LinkOutput()
        while self._waiting:
            out.add(self._use())
        out.add(self.following.finish())
        return out

    def _advance(self) -> LinkOutput:
        out = LinkOutput()
        while self._waiting and self._ready():
            out.add(self._use())
        return out

    def _ready(self) -> bool:
        """Whether the strokes up to the end of the oldest burst are there, or are waited for no more."""
        if self._strokes_until is None:
            return True
        (start, period, values), newest = self._waiting[0], self._waiting[-1]
        end = start + round(period * len(values) * NANOSECONDS)
        waited = newest[0] + round(newest[1] * len(newest[2]) * NANOSECONDS) - end
        return self._strokes_until >= end or waited > _WAIT_S * NANOSECONDS

    def _use(self) -> LinkOutput:
        start, period, values = self._waiting.popleft()
        time = (start - (self._origin_ns or 0)) / NANOSECONDS + period * np.arange(len(values), dtype=np.float64)
        return self.following.push(time, values)
