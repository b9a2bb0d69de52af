"""Samples of the graph to the page: kept as bytes as they come, decoded together, twenty times a second."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mwd_msgs import msg

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros.lifecycle_node import WARN, Finding, GraphNode
from mwd_sensors.ros.qos import WATCHED_STATE
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.live.live_state import LiveState

Act = Callable[[Samples, float], None]


class LiveFeed:
    """
    Fixed-layout topics on their way to the page.

    on_attitude, on_rig_state : callable
        Who else gets these samples, before the page does.

    Attributes
    ----------
    buffers : dict
        For each topic the list to which its serialised messages are appended as they come.
    """

    def __init__(
        self,
        node: GraphNode[Any],
        live: LiveState,
        *,
        on_attitude: Callable[[Samples], None],
        on_rig_state: Callable[[Samples], None],
    ) -> None:
        self._node, self._live = node, live
        self._on_attitude, self._on_rig_state = on_attitude, on_rig_state
        # In the order in which they are brought: what the next one shows may depend on it.
        self._ways: dict[str, tuple[wire.Layout, Act]] = {
            "rig/state": (wire.RIG_STATE, self._take_rig_state),
            "gravity": (wire.GRAVITY, live.on_gravity),
            "attitude": (wire.ATTITUDE, self._take_attitude),
            "dynamics": (wire.DYNAMICS, live.on_dynamics),
            "interference": (wire.INTERFERENCE, live.on_interference),
            "imu/temperature": (wire.TEMPERATURE, live.on_temperature),
            "imu/mag": (wire.MAG, live.on_magnetic_field),
        }
        self.buffers: dict[str, list[bytes]] = {topic: [] for topic in self._ways}
        self._unreadable = 0

    def open(self) -> None:
        """Open the toolface topic."""
        self._toolface = self._node.publish_on(msg.Toolface, "toolface", WATCHED_STATE)

    def bring(self, now: float) -> None:
        """Everything that waits."""
        for topic in self._ways:
            self.bring_one(topic, now)

    def bring_one(self, topic: str, now: float) -> None:
        """What waits of one topic."""
        waiting = self.buffers[topic]
        if not waiting:
            return
        taken = list(waiting)
        waiting.clear()
        layout, act = self._ways[topic]
        try:
            rows = np.frombuffer(b"".join(taken), dtype=np.uint8).reshape(len(taken), -1)
            samples = layout.decode(rows)
        except ValueError as error:
            self._unreadable += len(taken)
            self._node.get_logger().warning(f"{topic}: {error}", throttle_duration_sec=10.0)
            return
        act(samples, now)

    def _take_rig_state(self, samples: Samples, now: float) -> None:
        self._on_rig_state(samples)
        self._live.on_rig_state(samples, now)

    def _take_attitude(self, samples: Samples, now: float) -> None:
        self._on_attitude(samples)
        self._live.on_attitude(samples, now)
        reading = self._live.toolface_reading
        if reading is None:
            return
        message = msg.Toolface(
            mode=reading.mode,
            angle=reading.angle,
            sigma=reading.sigma,
            rotating=reading.rotating,
            rotary_speed=reading.rotary_speed,
        )
        message.header.stamp = stamp(reading.stamp_ns)
        message.header.frame_id = wire.SONDE_FRAME
        self._toolface.publish(message)

    def findings(self) -> list[Finding]:
        """What could not be read."""
        if not self._unreadable:
            return []
        return [Finding("messages", WARN, f"{self._unreadable} could not be read", "are all nodes of one version?")]
