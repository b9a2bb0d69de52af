# SPDX-License-Identifier: Apache-2.0
"""Monitor of the inputs of a well: clock offset and age of each input, and the source of the bit depth."""

from __future__ import annotations

import numpy as np

from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.wire import NANOSECONDS, RIG_VALID
from mwd_surface.list_files.list_checks import DEEPEST
from mwd_surface.live.inputs import GAUGE, SONDE, DepthSources, InputClock, InputTable, StampClock
from mwd_surface.live.source_selection import MODBUS, OPCUA, WITS, SourceSelection, short_name
from mwd_surface.live.well_context import WellContext

# Data of these rig interfaces get the surface's time when they arrive.
_OURS = (OPCUA, WITS, MODBUS)


class InputMonitor:
    """
    Monitor of the inputs of one well; publishes and shows their table each second.

    Parameters
    ----------
    link : bool
        Whether the tool is received over a telemetry link, whose words have stamps of the rig's gauge.
    """

    def __init__(self, context: WellContext, selection: SourceSelection, *, link: bool) -> None:
        self._clock, self._live, self._outlet = context.clock, context.live, context.outlet
        self._depths, self._selection = DepthSources(selection), selection
        self._over_link = link
        self._clocks: dict[str, InputClock] = {}
        self._block = BlockTrack()
        self.table = InputTable()

    def on_sonde(self, samples: Samples) -> None:
        """Accept samples with stamps of the sonde's clock."""
        if len(samples):
            self._note(SONDE, int(samples["stamp_ns"][-1]))

    def on_gauge(self, stamp_ns: int) -> None:
        """Accept the stamp of the newest sample of a link's gauge, ns."""
        self._note(GAUGE, stamp_ns)

    def on_rig_input(self, frame: str, samples: Samples) -> None:
        """Accept rig data, `wire.RIG_STATE`, of any source; frame is the frame name of the messages."""
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
        """Return the bit depth of the source of rig data, m, even if a depth by hand is in force; None if unknown."""
        return self._depths.of_source(self._clock.now)

    def in_force(self, samples: Samples) -> tuple[Samples, Samples]:
        """
        Return the rig data in force twice: with the depth for pairing with surveys, and with the depth to be shown.

        If the source gives no depth, or a depth by hand has precedence, the last depth is updated from block and slips.
        If that is not possible, the data for surveys have no depth, and the shown data have the depth by hand.
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
        Return the time at which a sample was measured, s.

        name is SONDE, or any other word for the source of rig data in force. now is the time of arrival, s. This time
        is returned if the stamps are simulated time or from the surface's own clock, or if no offset is known yet.
        """
        source = name if name == SONDE else short_name(self._selection.source or "")
        clock = self._clocks.get(source)
        if clock is None or self._clock_of(source) in (StampClock.SIMULATED, StampClock.HOST):
            return now
        return clock.measured_at(stamp_ns, self._clock, now)

    def _note(self, name: str, stamp_ns: int) -> None:
        self._clocks.setdefault(name, InputClock()).note(stamp_ns, self._clock.now_ns, self._clock.now)

    def _clock_of(self, name: str) -> StampClock:
        if name in _OURS:
            return StampClock.HOST
        if self._outlet.is_simulated():
            return StampClock.SIMULATED
        return StampClock.TOOL if name == SONDE and not self._over_link else StampClock.RIG

    def update(self, now: float, *, shown: bool = True) -> None:
        """
        Publish the table of inputs, and show it on the page; called once a second.

        now: steady time, s. shown: False if the page shows the table of a recording instead.
        """
        host_ns = self._clock.now_ns
        states = {name: clock.state(name, self._clock_of(name), host_ns, now) for name, clock in self._clocks.items()}
        self.table = self._depths.table(states, now)
        self._outlet.on_inputs(self.table)
        if shown:
            self._live.show(now, inputs=self.table)


# Bit depth from the travelling block, for rig data without a bit depth.


_BIT_DEPTH = RIG_VALID["bit_depth"]
_MOVES = RIG_VALID["block_position"] | RIG_VALID["in_slips"]
_LONGEST = 5.0  # longest time between two readings, s; in a longer gap the slips may have been set and pulled
# Largest speed of the block, m/s, and allowance, m; a larger movement means that the encoder was reset.
_FASTEST, _SLACK = 3.0, 0.5


class BlockTrack:
    """Bit depth that starts at the last depth from rig or person and follows the travelling block."""

    def __init__(self) -> None:
        #: Bit depth after the last reading, m; None if no depth was given yet, or if a reading of the block was missing
        #: or not plausible since then.
        self.depth: float | None = None
        # Stamp, ns, block position, m, and slips of the last reading; None after `start`, or if a value was missing.
        self._last: tuple[int, float, bool] | None = None
        self._begins = False

    def start(self, bit_depth: float) -> None:
        """Start at a bit depth, m, which is valid at the next reading of the block."""
        self.depth, self._last, self._begins = bit_depth, None, True

    def carry(self, samples: Samples) -> Samples:
        """
        Return rig data, `wire.RIG_STATE`, with missing bit depths computed from block and slips and marked valid.

        The data are in order of time, from one source at a time; they are not changed in place.
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
        """
        Return the depth at a reading, from the depth at the previous reading.

        The result is None if the movement of the block between the two readings is unknown.
        """
        if self._begins:
            return depth
        if self._last is None:
            return None
        span, rise = (reading[0] - self._last[0]) / NANOSECONDS, reading[1] - self._last[1]
        if not 0.0 < span <= _LONGEST or abs(rise) > _FASTEST * span + _SLACK:
            return None
        return depth if reading[2] or self._last[2] else depth - rise
