"""The simulated link in the graph: `tool/transmission` in; `tool/flow`, `rig/standpipe` and `rig/strokes` out."""

from __future__ import annotations

from typing import Any

import numpy as np
from mwd_msgs.msg import PressureBurst, StrokeBurst, ToolFlow, Transmission

from mwd_sensors.core import gauge_burst, wire
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.time_stamps import stamp
from mwd_sensors.simulator.sonde import Sonde
from mwd_sensors.simulator.telemetry_link import PERIOD_S, Heard

# The channel follows the run so far behind, s of wall time and s of the run: by then the tool has said what it sends.
_WALL_S, _RUN_S = 1.0, 1.0


class TelemetryTopics:
    """
    Topics of the link of a simulated sonde.

    Parameters
    ----------
    node : GraphNode
    rate : float
        Seconds of the run in a second of wall time.

    Raises
    ------
    ValueError
        The run has no pace, so nobody can say when the tool has answered.
    """

    def __init__(self, node: GraphNode[Any], rate: float) -> None:
        if rate <= 0.0:
            raise ValueError("rate: a scenario with telemetry needs a pace above 0, for example 10")
        self._node, self._rig_frame = node, node.frame(wire.RIG_FRAME)
        self._lag_s = _RUN_S + _WALL_S * rate
        self._pressure = node.add_publisher(PressureBurst, "rig/standpipe", qos.EVENT)
        self._strokes = node.add_publisher(StrokeBurst, "rig/strokes", qos.EVENT)
        self._flow = node.add_publisher(ToolFlow, "tool/flow", qos.EVENT)
        node.add_subscription(Transmission, "tool/transmission", self._on_transmission, qos.EVENT)
        self._sonde: Sonde | None = None

    def start(self, sonde: Sonde) -> None:
        """Serve a run from its beginning."""
        self._sonde = sonde

    def publish(self, until_s: float) -> None:
        """Publish what the run has by a time, s: flow up to it, pressure up to the lag before it."""
        sonde = self._sonde
        if sonde is None or sonde.link is None:
            return
        times, flows = sonde.link.flows(until_s)
        samples = wire.TOOL_FLOW.empty(len(times))
        samples["stamp_ns"] = [sonde.stamp_ns(float(at), of_tool=True) for at in times]
        samples["flow"], samples["sigma"] = flows, sonde.link.flow_sigma
        for row in wire.TOOL_FLOW.encode(samples, self._node.frame(wire.SONDE_FRAME)):
            self._flow.publish(row.tobytes())
        for heard in sonde.link.advance(until_s - self._lag_s):
            self._publish_heard(sonde, heard)

    def drained(self, since_s: float) -> bool:
        """Whether all of a run that ended so long ago was published; does it once the tool has had time to answer."""
        sonde = self._sonde
        if since_s > _WALL_S and sonde is not None and sonde.link is not None:
            for heard in sonde.link.advance(sonde.duration):
                self._publish_heard(sonde, heard)
        return since_s > 2.0 * _WALL_S

    def _publish_heard(self, sonde: Sonde, heard: Heard) -> None:
        start_ns = sonde.stamp_ns(heard.start_s, of_tool=False)
        self._pressure.publish(gauge_burst.encode(start_ns, PERIOD_S, heard.pressure_pa, self._rig_frame))
        end_ns = start_ns + round(len(heard.pressure_pa) * PERIOD_S * wire.NANOSECONDS)
        message = StrokeBurst(
            pump=[pump for pump, _ in heard.strokes],
            stamp=[stamp(sonde.stamp_ns(at, of_tool=False)) for _, at in heard.strokes],
        )
        message.header.stamp, message.header.frame_id = stamp(end_ns), self._rig_frame
        self._strokes.publish(message)

    def _on_transmission(self, message: Transmission) -> None:
        sonde = self._sonde
        if sonde is None or sonde.link is None:
            return
        start_ns = message.header.stamp.sec * wire.NANOSECONDS + message.header.stamp.nanosec
        begins = np.array([sonde.seconds(start_ns + round(edge * wire.NANOSECONDS)) for edge in message.edges])
        width = message.pulse_width / (1.0 + sonde.scenario.clock.drift_ppm * 1e-6)
        sonde.link.send(np.column_stack([begins, begins + width]))

    def diagnostics(self) -> list[Diagnostic]:
        """Pulses that came too late for the channel."""
        link = self._sonde.link if self._sonde is not None else None
        if link is None:
            return []
        if link.late:
            return [Diagnostic("channel", WARN, f"{link.late} pulses came too late", "lower the rate")]
        return [Diagnostic("channel", OK, "pulses arrive in time")]
