# SPDX-License-Identifier: Apache-2.0
"""Alarms and events of one well: kept in one book, logged, published on `alarms` and shown on the page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mwd_msgs import msg, srv

from mwd_sensors.core.settings import printable
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.qos import LATCHED
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.live.alarms import AlarmBook, Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.ros import messages


class AlarmLog:
    """Alarms and events of one well."""

    def __init__(self, node: GraphNode[Any], live: LiveState) -> None:
        self.book = AlarmBook()
        self._node = node
        self._live = live
        self._published_version = -1

    def open(self) -> None:
        """Open topic and service."""
        self._publisher = self._node.add_publisher(msg.AlarmList, "alarms", LATCHED)
        self._node.add_service(srv.AcknowledgeAlarm, "acknowledge_alarm", self.acknowledge)

    def now_ns(self) -> int:
        """Time of the graph, ns."""
        return int(self._node.get_clock().now().nanoseconds)

    def log_event(self, source: str, text: str, severity: Severity = Severity.INFO) -> None:
        """Log an event that is no alarm."""
        text = printable(text)
        self.book.note(source, text, self.now_ns(), severity)
        self._node.get_logger().info(f"{source}: {text}")

    def raise_alarm(self, alarm_id: str, severity: Severity, text: str, remedy: str = "") -> None:
        """Raise an alarm, or raise it again."""
        text = printable(text)
        self.book.raise_alarm(alarm_id, severity, text, remedy, self.now_ns())
        self._node.get_logger().error(f"{text}; {remedy}" if remedy else text)

    def clear_alarm(self, alarm_id: str) -> None:
        """Clear an alarm whose cause has gone; without effect where it is not raised."""
        self.book.clear(alarm_id, self.now_ns())

    def set_alarms(self, prefix: str, causes: Mapping[str, tuple[int, str, str]]) -> None:
        """
        Set all alarms whose id starts with the prefix: raise those named, clear the others.

        causes: from id to severity, text and remedy.
        """
        self.book.sync(prefix, causes, self.now_ns())

    def publish(self, now: float) -> None:
        """Publish alarms and events if they have changed; called once a second. now: steady time, s."""
        if self.book.version == self._published_version:
            return
        self._published_version = self.book.version
        alarms = msg.AlarmList(alarms=[messages.alarm_message(a) for a in self.book.alarms()])
        alarms.header.stamp = stamp(self.now_ns())
        self._publisher.publish(alarms)
        self._live.on_alarms(self.book.alarms(), self.book.events(), now, self.now_ns())

    def acknowledge(self, request: Any, response: Any) -> Any:
        """Acknowledge an alarm (service)."""
        response.success, response.message = self.book.acknowledge(request.id, request.operator_name, self.now_ns())
        return response
