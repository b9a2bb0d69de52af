# SPDX-License-Identifier: Apache-2.0
"""
Topics of the simulated telemetry links.

The node subscribes to `tool/transmission`. It publishes `tool/flow` and the signals at the surface: `rig/standpipe` and
`rig/strokes` for a link through mud, `rig/earth_voltage` for a link through the earth, `rig/coil_voltage` for the field
of a coil, `rig/serial` for a wired tool.
"""

from __future__ import annotations

import math
from typing import Any

from mwd_msgs.msg import StrokeBurst, ToolFlow, Transmission

from mwd_sensors.core import gauge_burst, wire
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.messages import message_type
from mwd_sensors.simulator.sonde import Sonde
from mwd_sensors.simulator.telemetry_link import Heard, OnAir, Telemetry

# Lag of the simulated channel behind the simulation: wall time, s, and simulation time, s; both are added. The lag lets
# the tool's signals arrive before their time is simulated.
_WALL_S, _RUN_S = 2.0, 1.0


class TelemetryTopics:
    """
    Publishers and subscription for the links of a simulated sonde.

    Parameters
    ----------
    rate : float
        Seconds of simulation time per second of wall time.

    Raises
    ------
    ValueError
        The rate is not positive: the lag of the channel, which lets the tool's signals arrive, follows from the rate.
    """

    def __init__(self, node: GraphNode[Any], telemetry: Telemetry, rate: float) -> None:
        if rate <= 0.0:
            raise ValueError("rate: a scenario with telemetry needs a pace above 0, for example 10")
        self._node, self._rig_frame = node, node.frame(wire.RIG_FRAME)
        self._lag_s = _RUN_S + _WALL_S * rate
        topics = {tool.link: gauge_burst.TOPICS[tool.link] for tool in telemetry.tools}
        self._heard = {
            link: node.add_publisher(message_type(kind), topic, qos.EVENT) for link, (topic, kind) in topics.items()
        }
        self._strokes = node.add_publisher(StrokeBurst, "rig/strokes", qos.EVENT) if "mud_pulse" in topics else None
        self._flow = node.add_publisher(ToolFlow, "tool/flow", qos.EVENT)
        node.add_subscription(Transmission, "tool/transmission", self._on_transmission, qos.EVENT)
        self._sonde: Sonde | None = None

    def start(self, sonde: Sonde) -> None:
        """Connect the topics to a simulation that begins."""
        self._sonde = sonde

    def publish(self, until_s: float) -> None:
        """Publish the flow up to a simulation time, s, and the surface signals up to that time minus the lag."""
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
        """
        Publish the signals that remain at the end of a scenario; return whether they have been published.

        since_s: wall time since the end. The signals are published from `_WALL_S` after the end; the result is True
        from twice that time on.
        """
        sonde = self._sonde
        if since_s > _WALL_S and sonde is not None and sonde.link is not None:
            for heard in sonde.link.advance(sonde.duration):
                self._publish_heard(sonde, heard)
        return since_s > 2.0 * _WALL_S

    def _publish_heard(self, sonde: Sonde, heard: Heard) -> None:
        start_ns = sonde.stamp_ns(heard.start_s, of_tool=False)
        self._heard[heard.link].publish(gauge_burst.encode(start_ns, heard.period_s, heard.values, self._rig_frame))
        if self._strokes is None or heard.link != "mud_pulse":
            return
        end_ns = start_ns + round(len(heard.values) * heard.period_s * wire.NANOSECONDS)
        strokes = [(pump, sonde.stamp_ns(at, of_tool=False)) for pump, at in heard.strokes]
        self._strokes.publish(gauge_burst.encode_strokes(end_ns, strokes, self._rig_frame))

    def _on_transmission(self, message: Transmission) -> None:
        sonde = self._sonde
        if sonde is None or sonde.link is None or message.link not in self._heard:
            return
        start_ns = stamp_of(message.header.stamp)
        before = sonde.link.late
        sonde.link.send(
            OnAir(
                message.link,
                sonde.seconds(start_ns),
                tuple(message.edges),
                tuple(message.phases),
                bytes(message.octets),
                message.symbol_period if math.isnan(message.pulse_width) else message.pulse_width,
                message.carrier,
            )
        )
        if sonde.link.late > before:
            self._node.get_logger().warning(
                printable(
                    f"{sonde.link.late} signals of the tool came too late for the channel and are missing at the "
                    "surface: this machine is too slow for the rate; lower it"
                ),
                throttle_duration_sec=60.0,
            )

    def diagnostics(self) -> list[Diagnostic]:
        """Return one entry, a warning if signals came too late for the channel; [] before the simulation starts."""
        link = self._sonde.link if self._sonde is not None else None
        if link is None:
            return []
        if link.late:
            return [Diagnostic("channel", WARN, f"{link.late} signals came too late", "lower the rate")]
        return [Diagnostic("channel", OK, "signals arrive in time")]
