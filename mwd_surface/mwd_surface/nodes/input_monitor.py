# SPDX-License-Identifier: Apache-2.0
"""Clocks and ages of all inputs, and which source gives the depth: measured, published once a second, shown."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from mwd_msgs import msg

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.live.block_track import BlockTrack
from mwd_surface.live.inputs import GAUGE, SONDE, Clock, DepthSources, InputClock, InputState, InputTable
from mwd_surface.live.source_selection import MODBUS, OPCUA, WITS, SourceSelection, short_name
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.ros.topics import TOPICS
from mwd_surface.surveys.list_rules import DEEPEST

# Their data are stamped by us when they arrive.
_OURS = (OPCUA, WITS, MODBUS)


class InputMonitor:
    """
    The inputs of one well.

    Parameters
    ----------
    context : SurfaceContext
        Node, live state and time.
    link : bool
        Whether a telemetry link, whose words bear the time of the rig's gauge, stands between tool and surface.
    """

    def __init__(self, context: SurfaceContext, *, link: bool) -> None:
        self._context, self._node, self._live = context, context.node, context.live
        self._over_link = link
        self._clocks: dict[str, InputClock] = {}
        self._block = BlockTrack()
        self._simulated = False
        self.table = InputTable()

    def open(self, selection: SourceSelection) -> None:
        """Open the topic. selection: of the source of rig data."""
        self._depths = DepthSources(selection)
        self._publisher = self._node.add_publisher(msg.InputList, "inputs", TOPICS["inputs"][1])

    def on_sonde(self, samples: Samples) -> None:
        """Take samples that bear the time of the sonde."""
        if len(samples):
            self._note(SONDE, int(samples["stamp_ns"][-1]))

    def on_gauge(self, stamp_ns: int) -> None:
        """Take the time of the newest sample of a link's gauge."""
        self._note(GAUGE, stamp_ns)

    def on_rig_input(self, frame: str, samples: Samples) -> None:
        """Take rig data, `wire.RIG_STATE`, of any source; frame: that of its messages."""
        if not len(samples):
            return
        self._note(short_name(frame), int(samples["stamp_ns"][-1]))
        last = samples[-1]
        depth = float(last["bit_depth"])
        if int(last["valid"]) & msg.RigState.BIT_DEPTH and 0.0 <= depth <= DEEPEST:
            self._depths.take(frame, depth, time.monotonic())

    def on_depth_by_hand(self, bit_depth: float) -> None:
        """Take a bit depth that a person has set, m."""
        self._block.start(bit_depth)
        self._depths.set_by_hand(bit_depth, time.monotonic())

    def in_force(self, samples: Samples) -> tuple[Samples, Samples]:
        """
        Return the rig data in force as they are paired with surveys, and as they are shown.

        Where the source gives no depth, or a depth by hand goes before it, block and slips carry the last depth on;
        where they cannot, surveys are paired with no depth of the rig, and the depth by hand is shown.
        """
        now, bit = time.monotonic(), msg.RigState.BIT_DEPTH
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

    def _note(self, name: str, stamp_ns: int) -> None:
        self._clocks.setdefault(name, InputClock()).note(stamp_ns, self._context.now_ns(), time.monotonic())

    def is_simulated(self) -> bool:
        """Whether a simulator, which alone publishes the truth, has been seen since the node was configured."""
        self._simulated = self._simulated or self._node.count_publishers("truth") > 0
        return self._simulated

    def _clock_of(self, name: str) -> Clock:
        if name in _OURS:
            return Clock.HOST
        if self.is_simulated() or self._node.get_parameter("use_sim_time").value:
            return Clock.SIMULATED
        return Clock.TOOL if name == SONDE and not self._over_link else Clock.RIG

    def update(self, now: float) -> None:
        """Publish and show the inputs; called once a second. now: steady time, s."""
        host_ns = self._context.now_ns()
        states = {name: clock.state(name, self._clock_of(name), host_ns, now) for name, clock in self._clocks.items()}
        self.table = self._depths.table(states, now)
        self._live.on_inputs(self.table, now)
        message = list_message(self.table)
        message.header.stamp = stamp(host_ns)
        message.header.frame_id = self._node.frame(wire.RIG_FRAME)
        self._publisher.publish(message)

    def diagnostics(self) -> list[Diagnostic]:
        """Source of the depth, and the clock of each input."""
        table = self.table
        apart = f", {table.depth_difference:.1f} m from another source" if table.depth_difference is not None else ""
        text = f"depth from {table.depth_source}{apart}" if table.depth_source else "no depth comes in"
        rows = tuple((row.name, _words(row)) for row in table.inputs)
        level, remedy = (OK, "") if table.depth_source else (WARN, "connect the rig data, or set the depth by hand")
        return [Diagnostic("inputs", level, text, remedy, rows)]


def _words(row: InputState) -> str:
    if row.data_age is None or row.clock_offset is None:
        return "none came yet"
    return f"clock {row.clock.name.lower()}, offset {row.clock_offset:+.3f} s, age {row.data_age:.3f} s {row.reason}"


def list_message(table: InputTable) -> Any:
    """Message of the inputs, without its header."""

    def known(value: float | None) -> float:
        return -1.0 if value is None else value

    rows = [
        msg.InputState(
            name=row.name,
            clock=int(row.clock),
            clock_offset=row.clock_offset or 0.0,
            offset_age=known(row.offset_age),
            data_age=known(row.data_age),
            role=int(row.role),
            priority=row.priority,
            bit_depth=known(row.bit_depth),
            reason=row.reason,
        )
        for row in table.inputs
    ]
    return msg.InputList(
        inputs=rows,
        depth_source=table.depth_source,
        depth_age=known(table.depth_age),
        depth_difference=known(table.depth_difference),
    )
