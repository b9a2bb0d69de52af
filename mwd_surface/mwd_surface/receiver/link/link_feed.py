# SPDX-License-Identifier: Apache-2.0
"""
Feed of one link with bursts: convert stamps to times, and hold pressure until the strokes of its time arrive.

`FollowingLink` follows the tool to the configuration that a downlink command selects.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.telemetry.downlink import ECHO_WORD
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.link.link import Link, LinkOutput
from mwd_surface.receiver.link.link_attitude import AgeRules
from mwd_surface.receiver.lone_stamps import LONGEST_GAP_S, STEP_S
from mwd_surface.receiver.words import ReceivedWord

# Longest time for which pressure waits for strokes, s. The time must pass in the stamps of the pressure and on the
# clock: neither bursts that arrive together nor a paused replay show that a counter has failed.
_WAIT_S = 10.0
_EARLY = 200  # number of strokes that are kept before the first pressure sample


class _Burst(NamedTuple):
    """Stamps of the first sample and of the end, ns; time between samples, s; samples; time of arrival, s."""

    start_ns: int
    end_ns: int
    period_s: float
    values: Array
    arrived_s: float


class LinkFeed:
    """
    One link and the clock of its samples.

    Pressure waits for the pump strokes up to its end, so that live words equal those decoded from the recording.

    Parameters
    ----------
    warn : callable
        Called with a sentence each time the link is restarted.
    clock : callable
        Steady time, s, that decides when to stop waiting for a stroke counter.
    """

    def __init__(
        self,
        tool: ToolConfiguration,
        rules: AgeRules,
        warn: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        #: `tool`, `in_force`: configuration from the settings, and configuration after downlink commands.
        self.tool, self.in_force, self._rules, self._warn, self._clock = tool, tool, rules, warn, clock
        # Keep the strokes before the first pressure sample: they give the crank angle at its beginning.
        self._early: deque[tuple[int, int]] = deque(maxlen=_EARLY)
        self._strokes_until: int | None = None
        self._begin()

    def _begin(self) -> None:
        self._origin_ns: int | None = None
        self._end_ns = 0
        self._unconfirmed: _Burst | None = None
        self._waiting: deque[_Burst] = deque()
        self._stated: tuple[int, str] | None = None
        self.following = FollowingLink(Link(self.in_force, self.tool.link, self._rules, self.stamp_of))

    @property
    def link(self) -> Link:
        """Link with the configuration in force."""
        return self.following.link

    def stamp_of(self, seconds: float) -> int:
        """Return the stamp, ns, of a time on the clock of the samples, s."""
        return (self._origin_ns or 0) + round(seconds * NANOSECONDS)

    def seconds(self, stamp_ns: int) -> float | None:
        """
        Return the time on the clock of the samples, s, of a stamp.

        Return None before the first sample, and for a stamp that is more than an hour from the newest sample: the stamp
        is wrong, or the link will restart.
        """
        if self._origin_ns is None or abs(stamp_ns - self._end_ns) > LONGEST_GAP_S * NANOSECONDS:
            return None
        return (stamp_ns - self._origin_ns) / NANOSECONDS

    def push(self, start_ns: int, period_s: float, values: Array) -> LinkOutput:
        """
        Add a burst; return the output that it completes.

        start_ns: stamp of the first sample; period_s: time between samples; values: samples, shape (n,).

        The link restarts if the time jumps back, or forward by more than an hour. A burst whose time jumps waits for
        the next burst. If the next burst is nearer to the time before the jump, the waiting burst is dropped, because
        its stamp was wrong. Call `take_strokes` first for strokes that have already arrived, because this call stops
        waiting for a counter that stays silent.
        """
        end_ns = start_ns + round(period_s * len(values) * NANOSECONDS)
        burst, out = _Burst(start_ns, end_ns, period_s, values, self._clock()), LinkOutput()
        before, self._unconfirmed = self._unconfirmed, None
        if before is not None and abs(start_ns - before.end_ns) <= abs(start_ns - self._end_ns):
            out.add(self._accept(before))
        if self._origin_ns is not None and abs(start_ns - self._end_ns) > STEP_S * NANOSECONDS:
            self._unconfirmed = burst
        else:
            out.add(self._accept(burst))
        return out

    def _accept(self, burst: _Burst) -> LinkOutput:
        ahead = (burst.start_ns - self._end_ns) / NANOSECONDS
        if self._origin_ns is not None and not -STEP_S <= ahead <= LONGEST_GAP_S:
            self._warn(f"the time went {'back by more than 5 s' if ahead < 0.0 else 'on by more than an hour'}")
            self._begin()
            self._strokes_until = None
        if self._origin_ns is None:
            self._origin_ns = self._end_ns = burst.start_ns
            self._give_strokes(self._early)
            self._early.clear()
        self._end_ns = max(self._end_ns, burst.end_ns)
        self._waiting.append(burst)
        if self._strokes_until is not None and self._given_up():
            self._strokes_until = None
        return self._advance()

    @property
    def heard(self) -> bool:
        """Whether any sample has reached the link."""
        return math.isfinite(self.link.now_s)

    def take_strokes(self, until_ns: int, strokes: Sequence[tuple[int, int]]) -> LinkOutput:
        """
        Add strokes, each a pump and a stamp, ns; return the output of the pressure that waited for them.

        until_ns: stamp before which no other strokes will come.
        """
        if self._origin_ns is None:
            self._early += strokes
        else:
            self._give_strokes(strokes)
        self._strokes_until = until_ns
        return self._advance()

    def _give_strokes(self, strokes: Iterable[tuple[int, int]]) -> None:
        times: dict[int, list[float]] = {}
        for pump, at in strokes:
            seconds = self.seconds(at)
            if seconds is not None:
                times.setdefault(pump, []).append(seconds)
        for pump, found in times.items():
            self.following.take_strokes(pump, np.array(found))

    def finish(self) -> LinkOutput:
        """Return the output that is left when no more samples come."""
        out = LinkOutput()
        while self._waiting:
            out.add(self._use())
        out.add(self.following.finish())
        return out

    def _advance(self) -> LinkOutput:
        out = LinkOutput()
        while self._waiting and (self._strokes_until is None or self._strokes_until >= self._waiting[0].end_ns):
            out.add(self._use())
        return out

    def _given_up(self) -> bool:
        """Return whether the oldest burst has waited too long for strokes, which means the counter has failed."""
        oldest, newest = self._waiting[0], self._waiting[-1]
        of_data = (newest.end_ns - oldest.end_ns) / NANOSECONDS
        return of_data > _WAIT_S and newest.arrived_s - oldest.arrived_s > _WAIT_S

    def _use(self) -> LinkOutput:
        burst = self._waiting.popleft()
        start_s = (burst.start_ns - (self._origin_ns or 0)) / NANOSECONDS
        at = start_s + burst.period_s * np.arange(len(burst.values), dtype=np.float64)
        out = self.following.push(at, burst.values)
        # Check the state after each burst: a backlog is used in one call, and no state in between may be lost.
        quality = self.link.quality()
        if (quality.state, quality.reason) != self._stated:
            self._stated = (quality.state, quality.reason)
            out.states.append((self.link.now_s, quality))
        return out


# Link that follows the tool to the configuration a downlink command selects.


class FollowingLink:
    """Link to a tool that takes downlink commands."""

    def __init__(self, link: Link) -> None:
        self.link = link  #: link in force
        self._next: Link | None = None
        self._echo = 0
        self._kept = LinkOutput()

    @property
    def expects(self) -> int | None:
        """Code of the awaited answer of the tool; None if no answer is awaited."""
        return None if self._next is None else self._echo

    def expect(self, tool: ToolConfiguration, echo: int) -> None:
        """Also decode with the configuration after a command; echo: code by which the tool confirms the command."""
        self._next, self._echo = self.link.successor(tool), echo
        self._kept = LinkOutput()

    def go_on_as(self, tool: ToolConfiguration) -> None:
        """Read with a tool configuration that the tool now uses, and stop waiting for the answer to a command."""
        self._next = None
        if tool != self.link.tool:
            self.link = self.link.successor(tool)

    def push(self, time_s: Array, pressure_pa: Array) -> LinkOutput:
        """
        Add samples, as `Link.push`.

        While an answer is awaited, the samples are also decoded with the configuration after the command; when the tool
        answers, the link with this configuration replaces `link`, and all its output since `expect` is returned.
        """
        out = self.link.push(time_s, pressure_pa)
        if self._next is None:
            return out
        beside = self._next.push(time_s, pressure_pa)
        self._kept.add(beside)
        if not any(self._answers(word) for word in (*out.words, *beside.words)):
            return out
        self.link, self._next = self._next, None
        return self._kept

    def take_strokes(self, pump: int, time_s: Array) -> None:
        """Add counted strokes of a pump to the present link and, if a new configuration is awaited, to its link."""
        for link in (self.link, self._next):
            if link is not None:
                link.take_strokes(pump, time_s)

    def finish(self) -> LinkOutput:
        """Return the output that is left when no more pressure comes."""
        return self.link.finish()

    def _answers(self, word: ReceivedWord) -> bool:
        return word.usable and word.name.lower() == ECHO_WORD.lower() and word.raw == self._echo
