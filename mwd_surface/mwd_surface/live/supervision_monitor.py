# SPDX-License-Identifier: Apache-2.0
"""Gathers the readings of the supervision table: silent topics, clocks, heartbeats, disk and queue."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from mwd_sensors.core.arrays import Samples
from mwd_surface.live.supervision import TABLE, Supervision
from mwd_surface.live.well_context import WellContext


class SupervisionMonitor:
    """
    Supervises the nodes of one well by the table of `live.supervision`, and raises its alarms.

    Attributes
    ----------
    topics : frozenset of str
        Topics whose silence the table watches.
    judged : set of str
        Rows that had a reading at the last update.
    """

    def __init__(self, context: WellContext) -> None:
        self._clock, self._live, self._alarm_log = context.clock, context.live, context.alarm_log
        self._supervision = Supervision()
        self.topics = frozenset(row.alarm[6:] for row in TABLE if row.alarm.startswith("input."))
        self._received_at: dict[str, float] = {}
        self._figures: dict[str, float] = {}
        self._beat_at: dict[str, float] = {}
        self._stamp_ns = -1
        self._advanced_at = self._sampled_at = 0.0
        self.judged: set[str] = set()

    @property
    def heard(self) -> frozenset[str]:
        """Topics of which a message has come."""
        return frozenset(self._received_at)

    def message_received(self, topic: str) -> None:
        """Note that a message of the topic has arrived."""
        now = self._received_at[topic] = self._clock.now
        if topic == "imu/data_raw":
            # Alive though its magnetometer is silent; samples that nobody decodes here are not counted.
            self._live.on_stream("sonde", 0, now)

    def on_heartbeat(self, beat: Any) -> None:
        """Accept the heartbeat of a node, diagnostic_msgs/DiagnosticStatus."""
        node = beat.name.rpartition("/")[2]
        self._beat_at[node] = self._clock.now
        for pair in beat.values:
            name = {"longest_callback_s": "callback", "memory_mb": "memory"}.get(pair.key)
            if name is not None:
                self._figures[f"{name}.{node}"] = float(pair.value)

    def on_sonde(self, samples: Samples) -> None:
        """Accept samples that bear the time of the sonde."""
        self._sampled_at = self._clock.now
        newest = int(samples["stamp_ns"].max()) if len(samples) else self._stamp_ns
        # A clock that was set back advances too.
        if newest != self._stamp_ns:
            self._stamp_ns, self._advanced_at = newest, self._sampled_at

    def update(
        self,
        now: float,
        clock_difference: float | None,
        depth_difference: float,
        machine: Mapping[str, float],
    ) -> None:
        """
        Raise and clear the alarms of the table; called once a second.

        now: time, s. clock_difference: between the clocks of rig and sonde, s, None if unknown. depth_difference:
        between the sources of depth, m, NaN if unknown. machine: readings of the computer, by the id of their row.
        """
        readings = {f"input.{topic}": now - at for topic, at in self._received_at.items()}
        readings |= {f"heartbeat.{node}": now - at for node, at in self._beat_at.items()}
        readings |= self._figures
        readings["clock.sonde"] = self._sampled_at - self._advanced_at
        if clock_difference is not None:
            readings["clock.rig"] = abs(clock_difference)
        if math.isfinite(depth_difference):
            readings["depth.sources"] = depth_difference
        readings |= machine
        self.judged = set(readings)
        causes = self._supervision.judge(readings, now)
        for prefix in self._supervision.prefixes:
            self._alarm_log.set_alarms(prefix, {key: cause for key, cause in causes.items() if key.startswith(prefix)})
