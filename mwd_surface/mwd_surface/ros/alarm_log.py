"""The one place where things are said: the log, the alarms topic and the page hear the same."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mwd_msgs import msg, srv

from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.qos import LATCHED
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.live.alarms import AlarmBook, Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.ros import messages


class Journal:
    """Alarms and events of one well."""

    def __init__(self, node: GraphNode[Any], live: LiveState) -> None:
        self.book = AlarmBook()
        self._node = node
        self._live = live
        self._told = -1

    def open(self) -> None:
        """Open topic and service."""
        self._topic = self._node.publish_on(msg.AlarmList, "alarms", LATCHED)
        self._node.serve(srv.AcknowledgeAlarm, "acknowledge_alarm", self.acknowledge)

    def now_ns(self) -> int:
        """Time of the graph, ns."""
        return int(self._node.get_clock().now().nanoseconds)

    def note(self, source: str, text: str, severity: Severity = Severity.INFO) -> None:
        """Something happened that is no alarm."""
        self.book.note(source, text, self.now_ns(), severity)
        self._node.get_logger().info(f"{source}: {text}")

    def alarm(self, alarm_id: str, severity: Severity, text: str, remedy: str = "") -> None:
        """A cause is there (again)."""
        self.book.raise_alarm(alarm_id, severity, text, remedy, self.now_ns())
        self._node.get_logger().error(f"{text}; {remedy}" if remedy else text)

    def clear(self, alarm_id: str) -> None:
        """A cause has gone."""
        self.book.clear(alarm_id, self.now_ns())

    def sync(self, prefix: str, causes: Mapping[str, tuple[int, str, str]]) -> None:
        """All causes of one part: id, which starts with the prefix, to (severity, text, remedy)."""
        self.book.sync(prefix, causes, self.now_ns())

    def tell(self, now: float) -> None:
        """Publish what changed; called once a second."""
        if self.book.version == self._told:
            return
        self._told = self.book.version
        alarms = msg.AlarmList(alarms=[messages.alarm_message(a) for a in self.book.alarms()])
        alarms.header.stamp = stamp(self.now_ns())
        self._topic.publish(alarms)
        self._live.on_alarms(self.book.alarms(), self.book.events(), now)

    def acknowledge(self, request: Any, response: Any) -> Any:
        """Somebody has seen an alarm."""
        response.success, response.message = self.book.acknowledge(request.id, request.operator_name, self.now_ns())
        return response
