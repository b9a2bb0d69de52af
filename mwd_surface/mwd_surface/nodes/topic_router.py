# SPDX-License-Identifier: Apache-2.0
"""
Subscriptions of the surface node: each message is recorded, forwarded to Foxglove and handed to the well.

Streams wait in buffers and are taken twenty times a second; a message of any other topic is handled at once, after the
stream messages received before it.
"""

from __future__ import annotations

import operator
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from mwd_sensors.ros.diagnostics import WARN, Diagnostic
from mwd_sensors.ros.message_buffer import MessageBuffer
from mwd_sensors.ros.qos import STATE, buffered
from mwd_surface.live.alarms import Severity
from mwd_surface.nodes.foxglove_bridge import FoxgloveBridge
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.ros.topics import TOPICS, message_class, profile_yaml, type_name

_RECEIVED_NS = operator.itemgetter(0)

Handler = Callable[[bytes], None]


class TopicRouter:
    """
    Subscribes to the topics of the contract and to further topics that are to be recorded.

    Parameters
    ----------
    context : SurfaceContext
        Node and alarm log.
    record : callable
        `record(topic, type, data, received_ns, qos=...)`, called for the messages of recorded topics.
    foxglove : FoxgloveBridge
        Gets every message, where it is switched on.
    handlers : mapping
        From topic to the function that is called at once with each serialised message.
    put : callable
        `put(topic, data, received_ns)`, called with the messages of all other topics of the contract too.
    wanted : collection of str
        Topics that are subscribed to for `put`, recorded or not.
    """

    def __init__(
        self,
        context: SurfaceContext,
        *,
        record: Callable[..., None],
        foxglove: FoxgloveBridge,
        handlers: Mapping[str, Handler],
        put: Callable[[str, bytes, int], None],
        wanted: Collection[str],
    ) -> None:
        self._node, self._alarm_log = context.node, context.alarm_log
        self._record, self._foxglove, self._handlers = record, foxglove, handlers
        self._put, self._wanted = put, wanted
        self._streams: list[tuple[MessageBuffer, Callable[[bytes, int], None]]] = []
        self._missing: set[str] = set()

    def open(self, recorded_topics: list[str], excluded: Collection[str] = ()) -> None:
        """
        Subscribe to the topics of the contract that are recorded, forwarded or handled.

        excluded: topics that are not subscribed to, whoever asks for them.
        """
        node = self._node
        recorded = {node.resolve_topic_name(name): name for name in recorded_topics}
        for name, (msg_type, profile) in TOPICS.items():
            if name in excluded:
                recorded.pop(node.resolve_topic_name(name), None)
                continue
            is_recorded = recorded.pop(node.resolve_topic_name(name), None) is not None
            if is_recorded or self._foxglove.put is not None or name in self._handlers or name in self._wanted:
                self._subscribe(name, msg_type, profile, is_recorded=is_recorded)
        self._missing = set(recorded)

    def _subscribe(self, name: str, msg_type: Any, profile: QoSProfile, *, is_recorded: bool) -> None:
        full_name, typed, offered = self._node.resolve_topic_name(name), type_name(msg_type), profile_yaml(profile)
        handler = self._handlers.get(name)
        record = self._record if is_recorded else None
        self._foxglove.advertise(full_name, typed)
        forward = self._foxglove.put
        put = self._put if name in self._wanted else None
        latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL

        def route(data: bytes, received_ns: int) -> None:
            if record is not None:
                record(full_name, typed, data, received_ns, qos=offered)
            if forward is not None:
                forward(full_name, typed, data, received_ns, latched=latched)
            if put is not None:
                put(name, data, received_ns)
            if handler is not None:
                handler(data)

        def on_event(data: bytes) -> None:
            # Stream messages received before this one are recorded before it.
            self.take_streams()
            route(data, time.time_ns())

        if profile.reliability == ReliabilityPolicy.BEST_EFFORT:
            buffer = self._node.add_buffered_subscription(msg_type, name, buffered(profile))
            self._streams.append((buffer, route))
        else:
            self._node.add_subscription(msg_type, name, on_event, buffered(profile), raw=True)

    def take_streams(self) -> None:
        """Route the stream messages that wait, in the order in which they were received."""
        taken = []
        for buffer, route in self._streams:
            messages = buffer.take()
            if messages:
                taken += [(received_ns, route, data) for data, received_ns in messages]
        taken.sort(key=_RECEIVED_NS)
        for received_ns, route, data in taken:
            route(data, received_ns)

    def find_missing(self) -> None:
        """Subscribe to recorded topics outside the contract once they exist; called once a second."""
        if not self._missing:
            return
        for full_name, types in self._node.get_topic_names_and_types():
            if full_name in self._missing and types:
                self._missing.discard(full_name)
                msg_type = message_class(types[0])
                if msg_type is None:
                    text = f"{full_name} cannot be recorded: {types[0]} is not installed"
                    self._alarm_log.log_event("recorder", text, Severity.WARNING)
                    continue
                publishers = self._node.get_publishers_info_by_topic(full_name)
                profile = publishers[0].qos_profile if publishers else STATE
                # Discovery does not carry the history of a profile.
                offered = QoSProfile(depth=100, reliability=profile.reliability, durability=profile.durability)
                self._subscribe(full_name, msg_type, offered, is_recorded=True)

    def diagnostics(self) -> list[Diagnostic]:
        """Topics to be recorded that do not exist yet."""
        if not self._missing:
            return []
        message = f"not there yet: {', '.join(sorted(self._missing))}"
        return [Diagnostic("topics to record", WARN, message, "is the name right, and its publisher running?")]
