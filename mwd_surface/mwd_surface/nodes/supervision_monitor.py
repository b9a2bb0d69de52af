# SPDX-License-Identifier: Apache-2.0
"""Gathers the readings of the supervision table: silent topics, clocks, heartbeats, disk and queue."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import deserialize_message

from mwd_sensors.core.arrays import Samples
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.live.supervision import Supervision
from mwd_surface.ros.context import SurfaceContext


class SupervisionMonitor:
    """Supervises the nodes of one well by the table of `live.supervision`, and raises its alarms."""

    def __init__(self, context: SurfaceContext) -> None:
        self._live, self._alarm_log, self._folder = context.live, context.alarm_log, context.folder
        self._supervision = Supervision()
        self._received_at: dict[str, float] = {}
        self._figures: dict[str, float] = {}
        self._beat_at: dict[str, float] = {}
        self._stamp_ns = -1
        self._advanced_at = self._sampled_at = 0.0

    def message_received(self, topic: str) -> None:
        """Note that a message of the topic has arrived."""
        now = self._received_at[topic] = time.monotonic()
        if topic == "imu/data_raw":
            # Alive though its magnetometer is silent; samples that nobody decodes here are not counted.
            self._live.on_stream("sonde", 0, now)

    def on_heartbeat(self, data: bytes) -> None:
        """Take the serialised heartbeat of a node."""
        beat = deserialize_message(data, DiagnosticStatus)
        node = beat.name.rpartition("/")[2]
        self._beat_at[node] = time.monotonic()
        for pair in beat.values:
            name = {"longest_callback_s": "callback", "memory_mb": "memory"}.get(pair.key)
            if name is not None:
                self._figures[f"{name}.{node}"] = float(pair.value)

    def on_sonde(self, samples: Samples) -> None:
        """Take samples that bear the time of the sonde."""
        self._sampled_at = time.monotonic()
        newest = int(samples["stamp_ns"].max()) if len(samples) else self._stamp_ns
        # A clock that was set back advances too.
        if newest != self._stamp_ns:
            self._stamp_ns, self._advanced_at = newest, self._sampled_at

    def update(
        self, now: float, recorder: RecorderStatus, clock_difference: float | None, depth_difference: float | None
    ) -> None:
        """
        Raise and clear the alarms of the table; called once a second.

        now: steady time, s. recorder: status. clock_difference: of the clocks of rig and sonde, s; depth_difference: of
        the sources of depth, m; None: not known.
        """
        readings = {f"input.{topic}": now - at for topic, at in self._received_at.items()}
        readings |= {f"heartbeat.{node}": now - at for node, at in self._beat_at.items()}
        readings |= self._figures
        readings["clock.sonde"] = self._sampled_at - self._advanced_at
        if clock_difference is not None:
            readings["clock.rig"] = abs(clock_difference)
        if depth_difference is not None:
            readings["depth.sources"] = depth_difference
        readings["queue.recorder"] = 100.0 * recorder.queued_bytes / recorder.queue_limit
        readings |= _disk(self._folder)
        causes = self._supervision.judge(readings, now)
        for prefix in self._supervision.prefixes:
            self._alarm_log.set_alarms(prefix, {key: cause for key, cause in causes.items() if key.startswith(prefix)})


def _disk(folder: Path) -> dict[str, float]:
    """One over the free GB on the disk of a folder; nothing where that cannot be asked, which the recorder names."""
    try:
        free = shutil.disk_usage(folder).free
    except OSError:
        return {}
    return {"disk.low": 1e9 / max(free, 1)}
