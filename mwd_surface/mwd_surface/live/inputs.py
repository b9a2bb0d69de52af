# SPDX-License-Identifier: Apache-2.0
"""
Inputs of the surface: the clock that stamps each input, the offset of that clock, and the source of the bit depth.

The offset of a clock is a message's stamp minus its time of arrival at the surface, for the message with the shortest
delay in a minute, that is the largest difference (minimum filter of NTP, RFC 5905, section 10). A longer delay of other
messages is part of their age. No clock is read here: every call takes `now`, s, of one steady clock, and the surface's
time, ns.
"""

from __future__ import annotations

import collections
import dataclasses
import enum
import math
from typing import ClassVar

from mwd_sensors.core.message_record import MessageRecord
from mwd_sensors.core.unknown import or_nan
from mwd_sensors.core.wire import NANOSECONDS
from mwd_surface.live.source_selection import SourceSelection, short_name
from mwd_surface.live.well_clock import WellClock

SONDE, GAUGE, HAND, BLOCK = "sonde", "gauge", "hand", "block"
# Difference above which two depths disagree, m: a third of a joint of drill pipe, well above the stretch of the string
# and the rounding of a tally.
DISAGREEMENT = 3.0
_WINDOW = 60.0  # time in which the message with the shortest delay is sought, s


class StampClock(enum.IntEnum):
    """Owner of the clock that stamps an input, with the numbers of mwd_msgs/InputState."""

    HOST = 0
    TOOL = 1
    RIG = 2
    SIMULATED = 3


class Role(enum.IntEnum):
    """Role of an input's depth, with the numbers of mwd_msgs/InputState."""

    NO_DEPTH = 0
    STANDBY = 1
    IN_FORCE = 2
    SILENT = 3


@dataclasses.dataclass(frozen=True, eq=False)
class InputState(MessageRecord):
    """State of one input, with the fields of mwd_msgs/InputState; NaN if unknown."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/InputState"

    name: str
    clock: StampClock
    clock_offset: float = math.nan  #: the input's clock minus the surface's clock, s
    offset_age: float = math.nan  #: time since the message that gave the offset, s
    data_age: float = math.nan  #: age of the newest data, s
    role: Role = Role.NO_DEPTH
    priority: int = 0
    bit_depth: float = math.nan  #: bit depth that the input gives, m
    reason: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class InputTable(MessageRecord):
    """State of all inputs, with the fields of mwd_msgs/InputList."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/InputList"

    inputs: tuple[InputState, ...] = ()
    depth_source: str = ""  #: name of the input whose depth is in force, or empty
    depth_age: float = math.nan  #: age of the depth in force, s
    #: Largest difference between a live source and the depth in force, m; NaN without a second source.
    depth_difference: float = math.nan

    def named(self, name: str) -> InputState | None:
        """Return the input with a name; None if there is no such input."""
        return next((row for row in self.inputs if row.name == name), None)


class InputClock:
    """Clock offset and age of the data of one input."""

    def __init__(self) -> None:
        # Message with the shortest delay of each second: the second, time of arrival, s, and stamp minus arrival, s.
        self._best: collections.deque[tuple[int, float, float]] = collections.deque()
        self._stamp_ns: int | None = None

    def note(self, stamp_ns: int, host_ns: int, now: float) -> None:
        """Accept the newest stamp of data that arrived at `now`, s; host_ns is the surface's time of arrival, ns."""
        ahead, second = (stamp_ns - host_ns) / NANOSECONDS, math.floor(now)
        self._stamp_ns = stamp_ns
        if self._best and self._best[-1][0] == second:
            if ahead > self._best[-1][2]:
                self._best[-1] = (second, now, ahead)
        else:
            self._best.append((second, now, ahead))
        while now - self._best[0][1] > _WINDOW:
            self._best.popleft()

    def measured_at(self, stamp_ns: int, well: WellClock, now: float) -> float:
        """
        Return the time at which data with a stamp were measured, s, computed with the clock offset.

        now: time of arrival of the data, s; the result is not later.
        """
        offset = max((row[2] for row in self._best), default=0.0)
        return min(now, well.seconds(stamp_ns) - offset) if self._best else now

    def state(self, name: str, clock: StampClock, host_ns: int, now: float) -> InputState:
        """
        Return the state of the input at `now`, s; only name and clock before the first data.

        host_ns: the surface's time at `now`. Data stamped by the surface itself have the offset 0.
        """
        if self._stamp_ns is None:
            return InputState(name, clock)
        _, at, offset = max(self._best, key=lambda row: row[2])
        offset = 0.0 if clock == StampClock.HOST else offset
        age = max((host_ns - self._stamp_ns) / NANOSECONDS + offset, 0.0)
        return InputState(name, clock, offset, now - at, age)


class DepthSources:
    """Bit depths from sources of rig data, from a person and from the block, and the choice of the depth in force."""

    def __init__(self, selection: SourceSelection) -> None:
        self._selection = selection
        self._depths: dict[str, tuple[float, float]] = {}
        self._hand: tuple[float, float] | None = None
        self._block: tuple[float, float] | None = None

    def take(self, frame: str, bit_depth: float, now: float) -> None:
        """
        Accept a valid bit depth, m, of any source, in force or not.

        If the source in force agrees with a depth by hand within `DISAGREEMENT`, the depth by hand ends.
        """
        self._depths[short_name(frame)] = (now, bit_depth)
        in_force = frame == self._selection.source
        if self._hand is not None and in_force and abs(bit_depth - self._hand[1]) <= DISAGREEMENT:
            self._hand = None

    def set_by_hand(self, bit_depth: float, now: float) -> None:
        """Accept the bit depth, m, that a person has set."""
        self._hand = (now, bit_depth)

    def take_block(self, bit_depth: float | None, now: float) -> None:
        """Accept the depth computed from the block, m; None if the source in force gives a depth itself."""
        self._block = None if bit_depth is None else (now, bit_depth)

    def of_source(self, now: float) -> float | None:
        """Return the depth of the source in force, m, even if a depth by hand has precedence; None if unknown."""
        return self._live(now).get(short_name(self._selection.source or ""))

    def by_hand(self, now: float) -> float | None:
        """
        Return the depth by hand, m, if it has precedence over all sources; else None.

        A depth by hand has precedence for `hand_hold` after it was set, and then as long as no source sends a depth.
        """
        held = self._hand is not None and now - self._hand[0] <= self._selection.rules.hand_hold
        return self._hand[1] if self._hand is not None and (held or not self._live(now)) else None

    def table(self, states: dict[str, InputState], now: float) -> InputTable:
        """
        Return the table of all inputs.

        states holds the results of `InputClock.state` by name of the input; a source of rig data is named by the short
        name of its frame.
        """
        hand, source = self.by_hand(now), short_name(self._selection.source or "")
        live = self._live(now)
        name = HAND if hand is not None else source if source in live else ""
        depth = hand if hand is not None else live.get(source)
        if self._block is not None and now - self._block[0] <= self._selection.rules.silent_after:
            name, depth = BLOCK, self._block[1]
        rows = [state for key, state in states.items() if key not in self._depths]
        known = sorted(self._depths, key=lambda key: (self._selection.rank(key), key))
        rows += [self._row(key, states[key], name, live) for key in known if key in states]
        if self._hand is not None:
            age = now - self._hand[0]
            role = {HAND: Role.IN_FORCE, BLOCK: Role.STANDBY}.get(name, Role.SILENT)
            rows.append(InputState(HAND, StampClock.HOST, 0.0, age, age, role, 1, self._hand[1]))
        if name == BLOCK:
            of_source = states.get(source, InputState(BLOCK, StampClock.RIG))
            begun = "a depth by hand" if hand is not None else f"the last depth of {source}"
            words = f"{begun}, continued by the movement of the block"
            row = dataclasses.replace(of_source, name=BLOCK, role=Role.IN_FORCE, priority=1, bit_depth=or_nan(depth))
            rows.append(dataclasses.replace(row, reason=words))
        apart = [abs(other - depth) for key, other in live.items() if key != name] if depth is not None else []
        at = {HAND: self._hand, BLOCK: self._block}.get(name, self._depths.get(name))
        return InputTable(tuple(rows), name, math.nan if at is None else now - at[0], max(apart, default=math.nan))

    def _row(self, key: str, state: InputState, name: str, live: dict[str, float]) -> InputState:
        role = Role.SILENT if key not in live else Role.IN_FORCE if key == name else Role.STANDBY
        source = name or "nothing"
        reason = {Role.STANDBY: f"{source} is used", Role.SILENT: "sends no depth"}.get(role, "")
        priority = self._selection.rank(key) + (2 if self._hand is not None else 1)
        return dataclasses.replace(state, role=role, priority=priority, bit_depth=self._depths[key][1], reason=reason)

    def _live(self, now: float) -> dict[str, float]:
        silent = self._selection.rules.silent_after
        return {key: depth for key, (at, depth) in self._depths.items() if now - at <= silent}
