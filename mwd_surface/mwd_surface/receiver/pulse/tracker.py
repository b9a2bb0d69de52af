# SPDX-License-Identifier: Apache-2.0
"""
Tracker of the transmission of a pulse tool: several hypotheses of the sync are followed in parallel.

A hypothesis is a sync at a place, with the words, the clock and the channel that follow from it (`transmission.py`).
The score of a hypothesis is the log likelihood ratio of its pulses against no pulses, summed over its sync and its
words. Two hypotheses are compared on the pressure that both explain. A hypothesis is dropped when another one explains
this pressure clearly better, when no words follow its sync, when its parities fail, or when the flow goes off. Silence
alone does not end a hypothesis, because clock and sequence of the tool go on. The words of the leading hypothesis are
published once no other hypothesis explains the same pressure nearly as well.

Source: D. B. Reid, An algorithm for tracking multiple targets, IEEE Trans. Autom. Control 24 (1979) 843 (hypotheses
scored by their likelihood, decided later).
"""

from __future__ import annotations

import math

from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.belief import Doubt
from mwd_surface.receiver.flow_spans import FlowSpans
from mwd_surface.receiver.grid import STEPS_PER_TU, Grid
from mwd_surface.receiver.pulse.synchronisation import SyncFound
from mwd_surface.receiver.pulse.transmission import FADED, ReceivedTransmission
from mwd_surface.receiver.words import Reception

# A hypothesis is dropped if the log likelihood ratio of a better hypothesis against it exceeds `_BETTER` plus the share
# `_SHARE` of the evidence for the better one. The share is needed because the error of the model grows with the signal.
_BETTER, _SHARE = 12.0, 0.1
_MOST = 6  # largest number of hypotheses at a time
_APART_TU = 3  # syncs farther apart than this are not the same sync, TU; a pulse is 2 TU wide
# A leader with good parities is established after this number of packets. Later syncs are then not decoded. They are
# removed when the leader has been decoded this far beyond them, TU.
_ESTABLISHED, _BEYOND_TU = 30, 200
# Time for which the pressure falls before the start of a span without flow, and time after its start at which the span
# is known, s.
_FALLS_S, _SEEN_S = 4.0, 2.0


class Tracker:
    """
    Hypotheses about the transmission of one tool.

    Parameters
    ----------
    doubt : Doubt
        Doubt about the configuration.
    """

    def __init__(self, tool: ToolConfiguration, grid: Grid, flow: FlowSpans, doubt: Doubt) -> None:
        self._tool, self._grid, self._flow = tool, grid, flow
        self._all: list[ReceivedTransmission] = []
        self._frames = 0
        self.doubt = doubt
        self.leader: ReceivedTransmission | None = None  #: hypothesis whose words are published

    def offer(self, found: SyncFound, position: float) -> None:
        """
        Add the hypothesis of a sync at a position of the grid.

        It is not added if an existing hypothesis expects a sync there, or begins there with at least the same score. If
        there are then more than `_MOST`, the least probable one is dropped, but not the leader.
        """
        expecting = [one for one in self._all if one.expects_sync(position)]
        for one in expecting:
            one.offer_sync()
        for one in self._all:
            during = _APART_TU * STEPS_PER_TU < position - one.begin < self._tool.sync.length_tu * STEPS_PER_TU
            # Only a complete sync shows a second tool: the pulses of words often look like a sync without one pulse.
            if during and all(found.sent):
                one.second = max(one.second, found.score)
        near = [one for one in self._all if abs(one.begin - position) <= STEPS_PER_TU]
        if expecting or (near and max(one.score for one in near) >= found.score):
            return
        for one in near:
            if one.presence.packets == 0:
                self._all.remove(one)
        self._all.append(ReceivedTransmission(self._tool, self._grid, found, position, self.doubt.following()))
        if len(self._all) > _MOST:
            self._all.remove(min((one for one in self._all if one is not self.leader), key=lambda one: one.total))

    def due(self, searched: int, beyond: float) -> tuple[float, ReceivedTransmission | None]:
        """
        Return the lowest position up to which a next step needs pressure, and the hypothesis with this step.

        Return inf and None if no hypothesis has a next step.

        searched: position up to which syncs were sought; beyond: pressure that the search needs after a position.
        """
        rows = [
            (max(one.needs(), one.begins() + beyond if one.begins() > searched else 0.0), k)
            for k, one in enumerate(self._all)
            if not self._waits(one)
        ]
        if not rows:
            return math.inf, None
        needs, k = min(rows)
        return needs, self._all[k]

    def oldest(self) -> float:
        """Return the first position of the grid that any hypothesis still needs."""
        return min((one.keeps() for one in self._all), default=math.inf)

    def step(self, one: ReceivedTransmission) -> Reception:
        """Take the next step of a hypothesis; return the words and frames that can now be published."""
        done = Reception()
        off_s = self._off(one)
        if self._grid.seconds(one.at) >= off_s:
            self._end(one, done)
            return done
        one.step(off_s)
        if one.lost or one.sent:
            self._end(one, done)
        elif one.presence.hopeless:
            self._all.remove(one)
        else:
            self._compare(one, done)
        self._publish(done)
        return done

    def finish(self) -> Reception:
        """End all hypotheses; return the words of the best one, then of the best that begins after its last pulse."""
        done = Reception()
        while self._all:
            best = self.leader or max(self._all, key=lambda one: (one.presence.confirmed, one.total))
            self.leader = self.leader or best
            self._end(best, done)
        return done

    def _off(self, one: ReceivedTransmission) -> float:
        """Return when the flow went off during a hypothesis, s, as known at its next step; inf if it did not."""
        until = self._grid.seconds(one.needs()) - _SEEN_S
        begin = self._grid.seconds(one.begin)
        return min((x.start_s for x in self._flow.spans if begin < x.start_s <= until), default=math.inf) - _FALLS_S

    def _waits(self, one: ReceivedTransmission) -> bool:
        """Return whether a hypothesis is kept without being decoded, in case the leader ends before it."""
        leader = self.leader
        return leader is not None and leader is not one and self._established(leader) and one.begin > leader.begin

    def _established(self, one: ReceivedTransmission) -> bool:
        return one.sound and one.presence.packets >= _ESTABLISHED

    def _compare(self, one: ReceivedTransmission, done: Reception) -> None:
        """
        Compare a hypothesis with all others; of each pair, drop the one that explains the pressure clearly worse.

        Later syncs within the pulses of an established leader are dropped too.
        """
        others = [other for other in self._all if other is not one and other.presence.packets]
        for other in others:
            better, worse = (one, other) if self._ahead(one, other) >= 0.0 else (other, one)
            if self._ahead(better, worse) > _BETTER + _SHARE * better.total and better.presence.confirmed:
                self._end(worse, done, better)
                if worse is one:
                    return
        if self._established(one) and one is self.leader:
            beyond = one.heard - STEPS_PER_TU * _BEYOND_TU
            self._all = [other for other in self._all if other is one or not one.begin < other.begin < beyond]

    def _ahead(self, one: ReceivedTransmission, other: ReceivedTransmission) -> float:
        """Return the lead in log likelihood of a hypothesis over another one, on the pressure that both explain."""
        late, length = max(one.begin, other.begin), STEPS_PER_TU * self._tool.sync.length_tu
        begin = min(one.begin, other.begin)
        # Compare from the later begin on. Only if both begin within one sync, compare from the earlier begin on.
        begin = begin if late - begin < length else late
        end = min(one.end, other.end)
        return one.gained(begin, end) - other.gained(begin, end)

    def _end(self, one: ReceivedTransmission, done: Reception, better: ReceivedTransmission | None = None) -> None:
        """
        End a hypothesis, and publish its words if it is the leader.

        Without a leader and without a better hypothesis, the words of a confirmed hypothesis are published too. If
        `better` begins before the end of the sync of `one`, words are published only if earlier words were. If the
        tool has sent its whole transmission, hypotheses whose sync begins before its last pulse are dropped.
        """
        self._all.remove(one)
        if one is not self.leader and (self.leader is not None or better is not None or not one.presence.confirmed):
            return
        self.leader = None
        replaced = better is not None and better.begin < one.begin + STEPS_PER_TU * self._tool.sync.length_tu
        if replaced and not one.published:
            return
        if better is None and not one.lost:
            self._all = [other for other in self._all if other.begin > one.heard]
        one.close(math.inf if better is None else better.begin, FADED if better is not None else "")
        self._flush(one, done)
        self._frames = one.base + one.frames if one.published else self._frames

    def _publish(self, done: Reception) -> None:
        """
        Choose the leader, and publish its words unless another hypothesis is nearly as probable.

        A leader that is established, or whose words were published before, is not compared with others.
        """
        if self.leader is None:
            ready = [one for one in self._all if one.presence.confirmed]
            self.leader = max(ready, key=lambda one: one.total, default=None)
        leader = self.leader
        if leader is None:
            return
        rivals = [one for one in self._all if one is not leader and one.begin < leader.end]
        if not self._established(leader) and not leader.published:
            ahead = next((one for one in rivals if one.presence.confirmed and self._ahead(one, leader) > 0.0), None)
            if ahead is not None:
                self.leader = ahead
                return
            if any(self._ahead(leader, one) < _BETTER for one in rivals):
                return
        self._flush(leader, done)

    def _flush(self, one: ReceivedTransmission, done: Reception) -> None:
        """Publish the pending words of a hypothesis."""
        if not one.published:
            one.base, one.published = self._frames, True
        done.add(one.taken())
        self.doubt = one.doubt
