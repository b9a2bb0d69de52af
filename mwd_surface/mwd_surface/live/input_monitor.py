# SPDX-License-Identifier: Apache-2.0
"""Clocks and ages of all inputs, and which source gives the depth: measured, told once a second, shown."""

from __future__ import annotations

import numpy as np

from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import NANOSECONDS, RIG_VALID
from mwd_surface.live.inputs import GAUGE, SONDE, Clock, DepthSources, InputClock, InputTable
from mwd_surface.live.source_selection import MODBUS, OPCUA, WITS, SourceSelection, short_name
from mwd_surface.live.well_context import WellContext
from mwd_surface.surveys.list_rules import DEEPEST

# Data of these rig interfaces get the surface's time when they arrive.
_OURS = (OPCUA, WITS, MODBUS)


class InputMonitor:
    """
    The inputs of one well.

    Parameters
    ----------
    context : WellContext
    selection : SourceSelection
        Of the source of rig data.
    link : bool
        Whether a telemetry link, whose words bear the time of the rig's gauge, stands between tool and surface.
    """

    def __init__(self, context: WellContext, selection: SourceSelection, *, link: bool) -> None:
        self._clock, self._live, self._outlet = context.clock, context.live, context.outlet
        self._depths, self._selection = DepthSources(selection), selection
        self._over_link = link
        self._clocks: dict[str, InputClock] = {}
        self._block = BlockTrack()
        self.table = InputTable()

    def on_sonde(self, samples: Samples) -> None:
        """Accept samples that bear the time of the sonde."""
        if len(samples):
            self._note(SONDE, int(samples["stamp_ns"][-1]))

    def on_gauge(self, stamp_ns: int) -> None:
        """Accept the time of the newest sample of a link's gauge."""
        self._note(GAUGE, stamp_ns)

    def on_rig_input(self, frame: str, samples: Samples) -> None:
        """Accept rig data, `wire.RIG_STATE`, of any source; frame: that of its messages."""
        if not len(samples):
            return
        self._note(short_name(frame), int(samples["stamp_ns"][-1]))
        last = samples[-1]
        depth = float(last["bit_depth"])
        if int(last["valid"]) & RIG_VALID["bit_depth"] and 0.0 <= depth <= DEEPEST:
            self._depths.take(frame, depth, self._clock.now)

    def on_depth_by_hand(self, bit_depth: float, age: float = 0.0) -> None:
        """Accept a bit depth, m, that a person set `age` seconds ago."""
        self._block.start(bit_depth)
        self._depths.set_by_hand(bit_depth, self._clock.now - age)

    def depth_of_rig(self) -> float | None:
        """Return the bit depth that the source of rig data gives, m, also while one by hand goes before it, or None."""
        return self._depths.of_source(self._clock.now)

    def in_force(self, samples: Samples) -> tuple[Samples, Samples]:
        """
        Return the rig data in force as they are paired with surveys, and as they are shown.

        Where the source gives no depth, or a depth by hand goes before it, block and slips carry the last depth on;
        where they cannot, surveys are paired with no depth of the rig, and the depth by hand is shown.
        """
        now, bit = self._clock.now, RIG_VALID["bit_depth"]
        hand = self._depths.by_hand(now)
        if hand is not None:
            samples = samples.copy()
            samples["valid"] &= np.uint32(~bit & 0xFFFFFFFF)
        given = samples["valid"] & bit
        paired = self._block.carry(samples)
        if len(samples):
            carried = paired["valid"][-1] & bit and not given[-1]
            self._depths.take_block(self._block.depth if carried else None, now)
        if hand is None:
            return paired, paired
        shown = paired.copy()
        shown["bit_depth"][shown["valid"] & bit == 0] = hand
        shown["valid"] |= bit
        return paired, shown

    def measured_at(self, name: str, stamp_ns: int, now: float) -> float:
        """
        Return when a sample was measured, s.

        name: SONDE, or another word for the source of rig data in force. now: when the sample came, which is the answer
        where the clock that stamped it runs at a pace of its own, or is not known yet.
        """
        source = name if name == SONDE else short_name(self._selection.source or "")
        clock = self._clocks.get(source)
        if clock is None or self._clock_of(source) in (Clock.SIMULATED, Clock.HOST):
            return now
        return clock.measured_at(stamp_ns, self._clock, now)

    def _note(self, name: str, stamp_ns: int) -> None:
        self._clocks.setdefault(name, InputClock()).note(stamp_ns, self._clock.now_ns, self._clock.now)

    def _clock_of(self, name: str) -> Clock:
        if name in _OURS:
            return Clock.HOST
        if self._outlet.is_simulated():
            return Clock.SIMULATED
        return Clock.TOOL if name == SONDE and not self._over_link else Clock.RIG

    def update(self, now: float, *, shown: bool = True) -> None:
        """Tell and show the inputs; called once a second. now: time, s. shown: False where another list is shown."""
        host_ns = self._clock.now_ns
        states = {name: clock.state(name, self._clock_of(name), host_ns, now) for name, clock in self._clocks.items()}
        self.table = self._depths.table(states, now)
        self._outlet.on_inputs(self.table)
        if shown:
            self._live.show(now, inputs=self.table)


# Bit depth by the travelling block, where rig data give none.


_BIT_DEPTH = RIG_VALID["bit_depth"]
_MOVES = RIG_VALID["block_position"] | RIG_VALID["in_slips"]
_LONGEST = 5.0  # s between two readings; over a longer gap the slips may have been set and pulled
# A block falls at 3 m/s at most; what leaps farther is an encoder that was reset.
_FASTEST, _SLACK = 3.0, 0.5  # m/s, m


class BlockTrack:
    """
    Depth from the last one that rig or person gave on.

    Attributes
    ----------
    depth : float or None
        Bit depth, m, after the last reading; None: it was never given, or the block was lost since.
    """

    def __init__(self) -> None:
        self.depth: float | None = None
        # Stamp, block position and slips of the last reading; None where the depth begins at the next one.
        self._last: tuple[int, float, bool] | None = None
        self._begins = False

    def start(self, bit_depth: float) -> None:
        """Begin at a depth, m, that holds until the block is read next."""
        self.depth, self._last, self._begins = bit_depth, None, True

    def carry(self, samples: Samples) -> Samples:
        """
        Return rig data, `wire.RIG_STATE`; where the source sends no bit depth, block and slips give one, marked valid.

        The data are those of one source, or of one after the other, oldest first; they are not changed in place.
        """
        filled = samples
        for k, row in enumerate(samples):
            valid = int(row["valid"])
            known = valid & _MOVES == _MOVES
            reading = (int(row["stamp_ns"]), float(row["block_position"]), bool(row["in_slips"])) if known else None
            if valid & _BIT_DEPTH:
                self.depth, self._begins = float(row["bit_depth"]), False
            elif reading is not None and self.depth is not None:
                self.depth = self._moved(self.depth, reading)
                if self.depth is not None:
                    filled = samples.copy() if filled is samples else filled
                    filled["bit_depth"][k] = self.depth
                    filled["valid"][k] |= _BIT_DEPTH
            elif not self._begins:
                self.depth = None
            self._last, self._begins = reading, self._begins and reading is None
        return filled

    def _moved(self, depth: float, reading: tuple[int, float, bool]) -> float | None:
        """Depth at a reading from that at the one before; None where what happened between them is not known."""
        if self._begins:
            return depth
        if self._last is None:
            return None
        span, rise = (reading[0] - self._last[0]) / NANOSECONDS, reading[1] - self._last[1]
        if not 0.0 < span <= _LONGEST or abs(rise) > _FASTEST * span + _SLACK:
            return None
        return depth if reading[2] or self._last[2] else depth - rise
