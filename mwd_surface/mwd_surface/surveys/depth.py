# SPDX-License-Identifier: Apache-2.0
"""
Measured depth of a survey: the rig's bit depth at the time of the survey, minus the distance from sensor to bit.

Rig data contains placeholders, spikes and gaps. A reading that is not a depth is counted and dropped. Jumps faster
than a string can move, and jumps back in time, are accepted only when later readings confirm them. A survey gets its
depth only from readings near its own time, and the time between reading and survey is stored. If two depth sources
alternate, or the clock of the rig differs from that of the sonde, the survey gets no depth but a reason. Stamps are in
ns, depths in m.
"""

from __future__ import annotations

import array
import bisect
import collections
import dataclasses
import itertools
import math
from collections.abc import Iterable

from mwd_sensors.core.settings import setting
from mwd_surface.list_files.list_checks import DEEPEST

NS = 1e-9
#: Largest difference between the clocks of rig and sonde with which surveys get a depth from the rig, s.
CLOCK_LIMIT = 20.0
_REMEMBERED = 100  # number of rejected readings, and of jumps, that are kept to judge the depth of a survey
# Number of latest readings used to compare the clocks of rig and sonde; the difference of smallest magnitude counts
_COMPARED = 60
_FEWEST = 10  # smallest number of readings for comparing the clocks
_BY_HAND = "or give the depth by hand"
_NEW_START_NS = 60_000_000_000  # step back of the time from which a sonde has restarted, ns


@dataclasses.dataclass(frozen=True)
class DepthJumpRules:
    """Rules for depth readings that jump."""

    fastest: float = setting(
        5.0,
        "Fastest plausible speed of the string. A faster change of depth is rejected until further readings "
        "confirm it.",
        unit="m/s",
        low=0.1,
    )
    slack: float = setting(
        2.0,
        "Change of depth that is always plausible, however short the time. Raise it for a depth that is sent in "
        "coarse steps.",
        unit="m",
        low=0.0,
    )
    confirm: int = setting(
        3,
        "Number of consistent readings in a row that confirm a jump of depth. Raising it delays true corrections.",
        low=1,
    )
    deepest: float = setting(DEEPEST, "Largest plausible depth. A larger reading is rejected.", unit="m", low=1.0)


@dataclasses.dataclass(frozen=True)
class DepthRules(DepthJumpRules):
    """Rules for depth readings, and for the depth of a survey between them."""

    bridge: float = setting(
        60.0,
        "Longest gap of rig data over which the depth is interpolated. In a longer gap a survey gets the last depth "
        "before the gap, and waits for an operator if that depth is older than depth_age_limit. Raising it "
        "interpolates over gaps in which the string may have moved unevenly.",
        unit="s",
        low=0.1,
    )
    history: int = setting(
        36000,
        "Number of depth readings kept in memory; 36000 readings at 1 Hz are ten hours. Raising it gives a depth "
        "to surveys that arrive later, but costs memory.",
        low=10,
    )


@dataclasses.dataclass(frozen=True)
class DepthReading:
    """Depth of the sensor at a survey."""

    #: `measured_depth`, `bit_depth`: depth of the sensor and of the bit, m.
    measured_depth: float = math.nan
    depth_age: float = math.nan  #: time between the survey and the depth reading used, s
    bit_depth: float = math.nan
    reason: str = ""  #: why the depth is unknown, or empty
    by_hand: bool = False  #: whether a person entered the reading used


class DepthTrack:
    """Bit depth over time as reported by the rig."""

    def __init__(self, rules: DepthRules | None = None) -> None:
        self.rules = rules or DepthRules()
        self.refused_null = 0  #: number of readings dropped because they are not a depth
        self.refused_jump = 0  #: number of readings dropped because the depth changed faster than a string can move
        #: Number of readings dropped because they are not newer than an accepted reading, and no further readings
        #: confirm that the clock was set back.
        self.refused_order = 0
        # These arrays take 17 bytes per reading; lists of numbers would take 70.
        self._stamps = array.array("q")
        self._depths = array.array("d")
        self._by_hand = array.array("b")
        # Readings of a jump that is not confirmed yet.
        self._waiting: list[tuple[int, float]] = []
        # Readings that are much older than the latest one and not confirmed yet.
        self._earlier: list[tuple[int, float]] = []
        # Stamp, ns, and depth, m, of readings dropped as jumps; stamp of each confirmed jump, and the depth before it.
        self._left_out: collections.deque[tuple[int, float]] = collections.deque(maxlen=_REMEMBERED)
        self._jumps: collections.deque[tuple[int, float]] = collections.deque(maxlen=_REMEMBERED)
        self._sonde_ns: int | None = None
        self._clocks: collections.deque[float] = collections.deque(maxlen=_COMPARED)

    @property
    def latest(self) -> tuple[int, float] | None:
        """Stamp, ns, and bit depth, m, of the last accepted reading; None before the first reading."""
        return (self._stamps[-1], self._depths[-1]) if self._stamps else None

    @property
    def clock_difference(self) -> float | None:
        """
        Rig clock minus sonde clock, s; None before 10 rig readings have arrived after a sonde sample.

        The stamp of each rig reading is compared with the newest sonde stamp at the arrival of the reading. The
        difference of smallest magnitude in the last 60 readings is used.
        """
        return min(self._clocks, key=abs) if len(self._clocks) >= _FEWEST else None

    def note_sonde(self, stamp_ns: int) -> None:
        """
        Store the time of a sonde sample that has arrived; the next depth readings are compared with this time.

        A time before the stored one is ignored, unless it is more than 60 s before: the sonde has then restarted.
        """
        newest = self._sonde_ns
        if newest is None or stamp_ns > newest or newest - stamp_ns > _NEW_START_NS:
            self._sonde_ns = stamp_ns

    def update(self, stamp_ns: int, bit_depth: float, valid: bool = True) -> bool:
        """
        Process one reading of the rig; return whether it is accepted now.

        A reading that is not a depth (not marked valid, not finite, negative like the null value -999.25, or too deep)
        is counted and not used. A jump waits until `rules.confirm` consecutive readings agree; then all of them are
        accepted.

        Readings that are older than the latest one by more than `rules.bridge` wait in the same way. If they agree, the
        later stamps were wrong or the clock of the rig was set back, and the later readings are removed. A second
        source with another clock, or a clock that starts at 1970 for a moment, must not remove good readings.
        Therefore, if the sonde's time is known, the older readings must be nearer to the sonde's time than the latest
        reading is. If it is unknown, they must continue the movement of an accepted reading before them, or come for
        at least the time `rules.bridge` without a reading of the later clock in between.
        """
        if not valid or not math.isfinite(bit_depth) or not 0.0 <= bit_depth <= self.rules.deepest:
            self.refused_null += 1
            return False
        if self._sonde_ns is not None:
            self._clocks.append((stamp_ns - self._sonde_ns) * NS)
        reachable = not self._stamps or self._reachable(self._stamps[-1], self._depths[-1], stamp_ns, bit_depth)
        if self._stamps and stamp_ns <= self._stamps[-1]:
            self.refused_order += 1
            if stamp_ns == self._stamps[-1] and not reachable:
                # Two sources reported different depths for the same time.
                self._left_out.append((stamp_ns, bit_depth))
            return self._go_back(stamp_ns, bit_depth)
        self._earlier = []
        if reachable:
            self._leave_out()
            self._append(stamp_ns, bit_depth, False)
            return True
        if self._waiting and (
            stamp_ns <= self._waiting[-1][0] or not self._reachable(*self._waiting[-1], stamp_ns, bit_depth)
        ):
            self._leave_out()
        self._waiting.append((stamp_ns, bit_depth))
        if len(self._waiting) < self.rules.confirm:
            return False
        self._jumps.append((self._waiting[0][0], self._depths[-1]))
        for stamp, depth in self._waiting:
            self._append(stamp, depth, False)
        self._waiting = []
        return True

    def _go_back(self, stamp_ns: int, bit_depth: float) -> bool:
        """Process a reading older than the latest one by the rules of `update`; return whether it is accepted now."""
        if (self._stamps[-1] - stamp_ns) * NS <= self.rules.bridge:
            return False
        sonde_ns = self._sonde_ns
        if sonde_ns is not None and abs(stamp_ns - sonde_ns) >= abs(self._stamps[-1] - sonde_ns):
            return False
        if self._earlier and not (
            stamp_ns > self._earlier[-1][0] and self._reachable(*self._earlier[-1], stamp_ns, bit_depth)
        ):
            self._earlier = []
        self._earlier.append((stamp_ns, bit_depth))
        if len(self._earlier) < self.rules.confirm:
            return False
        # Accepting these readings removes all later ones. Without the sonde's clock, a short burst of readings with a
        # wrong clock must not do so: they must last for `rules.bridge`, or follow an accepted reading.
        lasts = (stamp_ns - self._earlier[0][0]) * NS >= self.rules.bridge
        if sonde_ns is None and not lasts and not self._continues(*self._earlier[0]):
            return False
        self.refused_order -= len(self._earlier)
        self._remove_from(self._earlier[0][0])
        for stamp, depth in self._earlier:
            self._append(stamp, depth, False)
        self._earlier = []
        return True

    def _continues(self, stamp_ns: int, bit_depth: float) -> bool:
        """
        Return whether a reading fits the last accepted reading before its time.

        The reading fits if it is at most `rules.bridge` later and the string can move that far in the time between.
        """
        at = bisect.bisect_left(self._stamps, stamp_ns) - 1
        return (
            at >= 0
            and (stamp_ns - self._stamps[at]) * NS <= self.rules.bridge
            and self._reachable(self._stamps[at], self._depths[at], stamp_ns, bit_depth)
        )

    def _remove_from(self, stamp_ns: int) -> None:
        """Remove the readings at and after a time, because they were wrong; forget all jumps and dropped readings."""
        at = bisect.bisect_left(self._stamps, stamp_ns)
        del self._stamps[at:], self._depths[at:], self._by_hand[at:]
        self._waiting = []
        self._left_out.clear()
        self._jumps.clear()

    def set_by_hand(self, stamp_ns: int, bit_depth: float) -> None:
        """
        Set a bit depth given by a person, without a jump test.

        Readings at and after the time are removed. The jump test compares further readings with the given depth.

        Raises
        ------
        ValueError
            The depth is not finite, negative or larger than `rules.deepest`.
        """
        if not math.isfinite(bit_depth) or not 0.0 <= bit_depth <= self.rules.deepest:
            raise ValueError(f"bit_depth: must be within 0 and {self.rules.deepest:g} m, got {bit_depth}")
        self._remove_from(stamp_ns)
        self._append(stamp_ns, bit_depth, True)

    def sensor_depth(self, stamp_ns: int, sensor_to_bit: float) -> DepthReading:
        """
        Return the depth of the sensor at a time: bit depth minus `sensor_to_bit`, m; NaN with a reason if unknown.

        Between two readings at most `rules.bridge` apart, the bit depth is interpolated linearly, and `depth_age` is
        the time to the nearer reading. Otherwise the last reading before the time is used, and `depth_age` is the time
        since that reading. A time before all readings gets the first reading if that reading is within `rules.bridge`.
        There is no interpolation towards a depth set by hand. The depth is unknown if there are no readings near the
        time, the clocks of rig and sonde differ, two depth sources alternate, or the sensor is above the datum.

        Raises
        ------
        ValueError
            sensor_to_bit is negative or not finite.
        """
        if not (math.isfinite(sensor_to_bit) and sensor_to_bit >= 0.0):
            raise ValueError(f"sensor_to_bit: must be 0 m or more, got {sensor_to_bit}")
        if not self._stamps:
            return DepthReading(reason="no depth from the rig yet: set it by hand or connect the rig data")
        after = bisect.bisect_left(self._stamps, stamp_ns)
        if after == 0:
            ahead = (self._stamps[0] - stamp_ns) * NS
            if ahead > self.rules.bridge:
                return DepthReading(
                    reason=self._clock_doubt() or f"the first depth reading came {ahead:.0f} s after the survey"
                )
            bit, age, hand = self._depths[0], ahead, bool(self._by_hand[0])
        else:
            before = after - 1
            bit, age = self._depths[before], (stamp_ns - self._stamps[before]) * NS
            hand = bool(self._by_hand[before])
            if after < len(self._stamps):
                span = (self._stamps[after] - self._stamps[before]) * NS
                # Do not interpolate between a reading and a person's correction, because no such depth was ever
                # reported.
                if span <= self.rules.bridge and not self._by_hand[after]:
                    bit += (self._depths[after] - bit) * (age / span)
                    age = min(age, span - age)
        doubt = "" if hand else self._doubt(stamp_ns, bit)
        if doubt:
            return DepthReading(math.nan, age, bit, doubt)
        depth = bit - sensor_to_bit
        if depth < 0.0:
            return DepthReading(math.nan, age, bit, f"bit at {bit:.2f} m: the sensor is still above the datum", hand)
        return DepthReading(depth, age, bit, "", hand)

    def _doubt(self, stamp_ns: int, bit: float) -> str:
        """Return the reason why the readings around a time give no reliable depth; empty if the depth is reliable."""
        if clock := self._clock_doubt():
            return clock
        jumps = self._around(self._jumps, stamp_ns)
        others = self._around(self._left_out, stamp_ns)
        # Spikes are scattered, whereas readings of another source agree with each other.
        agree = all(self._reachable(*a, *b) for a, b in itertools.pairwise(others))
        if len(jumps) > 1 or (len(others) >= self.rules.confirm and agree):
            other = others[-1][1] if others and agree else jumps[-1][1]
            return f"two sources of depth alternate, {bit:.1f} m and {other:.1f} m: stop one of them, {_BY_HAND}"
        return ""

    def _clock_doubt(self) -> str:
        """Return a sentence if the clocks of rig and sonde differ by more than `CLOCK_LIMIT`; otherwise empty."""
        apart = self.clock_difference or 0.0
        if abs(apart) <= CLOCK_LIMIT:
            return ""
        way = "ahead of" if apart > 0.0 else "behind"
        return f"the clock of the rig is {abs(apart):.0f} s {way} that of the sonde: set one of them, {_BY_HAND}"

    def _around(self, readings: Iterable[tuple[int, float]], stamp_ns: int) -> list[tuple[int, float]]:
        """Return the readings at most `rules.bridge` before or after a time, except 0 m, a placeholder of many rigs."""
        return [r for r in readings if abs(r[0] - stamp_ns) * NS <= self.rules.bridge and r[1] > 0.0]

    def _leave_out(self) -> None:
        self.refused_jump += len(self._waiting)
        self._left_out.extend(self._waiting)
        self._waiting = []

    def _reachable(self, stamp_1: int, depth_1: float, stamp_2: int, depth_2: float) -> bool:
        return abs(depth_2 - depth_1) <= self.rules.slack + self.rules.fastest * (stamp_2 - stamp_1) * NS

    def _append(self, stamp_ns: int, depth: float, by_hand: bool) -> None:
        self._stamps.append(stamp_ns)
        self._depths.append(depth)
        self._by_hand.append(by_hand)
        # Delete in blocks, so that the cost per reading is negligible.
        if len(self._stamps) > self.rules.history + self.rules.history // 4 + 1:
            old = len(self._stamps) - self.rules.history
            del self._stamps[:old], self._depths[:old], self._by_hand[:old]
