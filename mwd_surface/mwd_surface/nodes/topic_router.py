# SPDX-License-Identifier: Apache-2.0
"""
Routing of the messages of the surface node to the recording, to Foxglove and to the well.

Messages of streams (topics with a high rate) wait in buffers and are processed twenty times a second. A message of any
other topic is processed at once, after the stream messages received before it. A message that the node itself publishes
is recorded when it is published. Recording and well get the same messages in the same order with the same times, so
that playback of a recording gives the state that the live page showed.
"""

from __future__ import annotations

import operator
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message

from mwd_sensors.ros.diagnostics import WARN, Diagnostic
from mwd_sensors.ros.message_buffer import MessageBuffer
from mwd_sensors.ros.qos import STATE, buffered
from mwd_sensors.ros.refused_entity import RefusedEntityError, TopicPublisher
from mwd_surface.bags.definitions import installed
from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_well import LiveWell
from mwd_surface.nodes.foxglove_bridge import FoxgloveBridge
from mwd_surface.ros.context import SteadyTime, SurfaceContext
from mwd_surface.ros.topics import OF_SURFACE, TOPICS, message_class, profile_yaml, type_name

_RECEIVED_NS = operator.itemgetter(0)

Handler = Callable[[bytes], None]


class TopicRouter:
    """
    Subscriber to the topics in `TOPICS` (the contract), and to further topics that are to be recorded.

    Parameters
    ----------
    record : callable
        `record(topic, type, data, received_ns, qos=...)`, called for the messages of recorded topics.
    foxglove : FoxgloveBridge
        Bridge that receives every message if it is enabled.
    handlers : mapping
        Function that is called at once with each serialised message, by topic.
    well : LiveWell
        Well that receives the messages of its topics, recorded or not.
    """

    def __init__(
        self,
        context: SurfaceContext,
        *,
        record: Callable[..., None],
        foxglove: FoxgloveBridge,
        handlers: Mapping[str, Handler],
        well: LiveWell,
        steady: SteadyTime,
    ) -> None:
        self._node, self._alarm_log = context.node, context.alarm_log
        self._record, self._foxglove, self._handlers = record, foxglove, handlers
        self._well, self._steady = well, steady
        self._streams: list[tuple[MessageBuffer, Callable[[bytes, int], None]]] = []
        self._missing: set[str] = set()
        # Latched topics of this node: their last messages, and the function that records a message.
        self._latched: list[tuple[deque[bytes], Callable[[bytes], None]]] = []

    def open(self, recorded_topics: list[str], excluded: Collection[str] = ()) -> None:
        """
        Subscribe to the topics of the contract that are recorded, forwarded or handled.

        excluded: topics that are not subscribed to, even if they are in `recorded_topics`.
        """
        node = self._node
        own = {one.topic_name: one for one in node.publishers if isinstance(one, TopicPublisher)}
        recorded = {node.resolve_topic_name(name): name for name in recorded_topics}
        for name, (msg_type, profile) in TOPICS.items():
            if name in excluded:
                recorded.pop(node.resolve_topic_name(name), None)
                continue
            is_recorded = recorded.pop(node.resolve_topic_name(name), None) is not None
            publisher = own.get(node.resolve_topic_name(name)) if name in OF_SURFACE else None
            if publisher is not None:
                self._keep_published(publisher, name, is_recorded=is_recorded)
            elif is_recorded or self._foxglove.put is not None or name in self._handlers or name in self._well.topics:
                self._subscribe(name, msg_type, profile, is_recorded=is_recorded)
        self._missing = set(recorded)

    def _subscribe(self, name: str, msg_type: Any, profile: QoSProfile, *, is_recorded: bool) -> None:
        full_name, typed, offered = self._node.resolve_topic_name(name), type_name(msg_type), profile_yaml(profile)
        handler = self._handlers.get(name)
        record = self._record if is_recorded else None
        self._foxglove.advertise(full_name, typed)
        forward = self._foxglove.put
        put = self._well.put if name in self._well.topics else None
        latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL

        def route(data: bytes, received_ns: int) -> None:
            arrived_ns = max(self._steady.of(received_ns), self._well.next_arrival_ns)
            received_ns = self._steady.wall_of(arrived_ns)
            if record is not None:
                record(full_name, typed, data, received_ns, qos=offered)
            if forward is not None:
                forward(full_name, typed, data, received_ns, latched=latched)
            if put is not None:
                put(name, data, arrived_ns)
            if handler is not None:
                handler(data)

        def on_event(data: bytes) -> None:
            # Record the stream messages received before this message first.
            self.take_streams()
            route(data, time.time_ns())

        if profile.reliability == ReliabilityPolicy.BEST_EFFORT:
            buffer = self._node.add_buffered_subscription(msg_type, name, buffered(profile))
            self._streams.append((buffer, route))
        else:
            self._node.add_subscription(msg_type, name, on_event, buffered(profile), raw=True)

    def _keep_published(self, publisher: TopicPublisher, name: str, *, is_recorded: bool) -> None:
        """Record and forward each message of a topic of this node when it is published, with the time of the well."""
        msg_type, profile = TOPICS[name]
        full_name, typed, offered = publisher.topic_name, type_name(msg_type), profile_yaml(profile)
        record, forward = self._record if is_recorded else None, self._foxglove.put
        self._foxglove.advertise(full_name, typed)
        latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        definitions = installed()

        def keep(data: bytes) -> None:
            if record is not None:
                record(full_name, typed, data, self._steady.wall_of(self._well.next_arrival_ns), qos=offered)

        last: deque[bytes] = deque(maxlen=profile.depth if latched else 0)
        self._latched.append((last, keep))

        def on_published(message: Any) -> None:
            data = serialize_message(message)[: definitions.size(typed, message)]
            keep(data)
            last.append(data)
            if forward is not None:
                forward(full_name, typed, data, time.time_ns(), latched=latched)

        publisher.on_published = on_published

    def repeat_latched(self) -> None:
        """Record the latched messages of this node's topics again, for a recording that has just begun."""
        for last, keep in self._latched:
            for data in last:
                keep(data)

    def take_streams(self) -> None:
        """Route the waiting stream messages in the order in which they were received."""
        taken = []
        for buffer, route in self._streams:
            messages = buffer.drain()
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
                # Discovery does not report the history policy of a profile.
                offered = QoSProfile(depth=100, reliability=profile.reliability, durability=profile.durability)
                try:
                    self._subscribe(full_name, msg_type, offered, is_recorded=True)
                except RefusedEntityError as error:
                    text = f"{full_name} cannot be recorded: {error}"
                    self._alarm_log.log_event("recorder", text, Severity.WARNING)

    def diagnostics(self) -> list[Diagnostic]:
        """Return a diagnostic of the topics that are to be recorded and do not exist yet; none if all exist."""
        if not self._missing:
            return []
        message = f"these topics do not exist yet: {', '.join(sorted(self._missing))}"
        return [Diagnostic("topics to record", WARN, message, "check the name, and that a node publishes this topic")]
