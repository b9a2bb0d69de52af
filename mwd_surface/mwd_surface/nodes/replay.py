"""A recording as a node: publishes its bytes again, at their own pace or another, with /clock."""

from __future__ import annotations

import dataclasses
import importlib
import math
import time
from collections.abc import Iterator, Sequence
from typing import Any

from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from mwd_estimation.nodes.messages import stamp
from mwd_sensors import wire
from mwd_sensors.nodes.graph_node import OK, WARN, Finding, GraphNode, run_node
from mwd_sensors.nodes.listeners import Listeners
from mwd_sensors.nodes.profiles import STATE, STREAM
from mwd_sensors.settings import setting
from mwd_surface.bags.bag_metadata import parse_qos
from mwd_surface.bags.bag_reader import Bag, BagError, Message
from mwd_surface.bags.pace import Pace

_TICK_S = 0.002
_MOST_PER_TICK = 200  # so that signals and services are heard even when everything is late


@dataclasses.dataclass(frozen=True)
class ReplaySettings:
    """Parameters of the replay node."""

    bag: str = setting("", "Folder of the recording, or its .mcap or .db3 file", fixed=True)
    rate: float = setting(
        1.0,
        "Seconds of the recording per second on the wall; 0: as fast as possible",
        low=0.0,
        high=1000.0,
        fixed=True,
    )
    loop: bool = setting(False, "Begin again at the end", fixed=True)
    start_s: float = setting(0.0, "Begin so long after the first message", unit="s", low=0.0, fixed=True)
    end_s: float = setting(0.0, "End so long after the first message; 0: at the last", unit="s", low=0.0, fixed=True)
    topics: list[str] = setting([], "Publish only these; empty: all", fixed=True)
    sensors_only: bool = setting(False, "Publish only what a sonde and a rig publish", fixed=True)
    clock_hz: float = setting(100.0, "Rate of /clock on the wall; 0: none", unit="Hz", low=0.0, high=1000.0, fixed=True)
    wait_for_listener_s: float = setting(
        3.0, "Wait up to so long for somebody to listen before starting", unit="s", low=0.0, high=600.0, fixed=True
    )


class ReplayNode(GraphNode[ReplaySettings]):
    """Publishes a bag; ends the process with its last message unless it loops."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("replay", ReplaySettings(), **node_options)
        self._bag: Bag | None = None
        self._sent = self._rounds = 0

    def open(self) -> None:
        """Open the bag and a publisher for each topic whose type is installed."""
        settings = self.settings
        if not settings.bag:
            raise ValueError("bag: must be given: which recording to publish")
        try:
            self._bag = Bag(settings.bag)
            self._from_ns = self._bag.start_ns + round(settings.start_s * 1e9)
            self._to_ns = self._bag.start_ns + round(settings.end_s * 1e9) if settings.end_s > 0.0 else None
            self._outlets, self._left_out = self._open_outlets(self._bag)
        except BagError as error:
            raise ValueError(str(error)) from error
        for sentence in (*self._bag.notes, *self._left_out):
            self.get_logger().warning(sentence)
        if not self._outlets:
            raise ValueError(f"{settings.bag} has no topic that can be published here")
        self._clock_topic = self.publish_on(Clock, "/clock", STATE) if settings.clock_hz > 0.0 else None
        self.serve(Trigger, "~/pause", self._pause)
        self.serve(Trigger, "~/resume", self._resume)
        self.every(_TICK_S, self._tick)

    def _open_outlets(self, bag: Bag) -> tuple[dict[str, Any], list[str]]:
        outlets, left_out = {}, []
        asked = set(self.settings.topics)
        unknown = asked - bag.topics.keys()
        if unknown:
            raise BagError(f"{bag.path} has no topic {', '.join(sorted(unknown))}", f"it has {', '.join(bag.topics)}")
        for about in bag.topics.values():
            if (asked and about.name not in asked) or (self.settings.sensors_only and not _is_sensor(about.name)):
                continue
            if about.name == "/clock" and self.settings.clock_hz > 0.0:
                left_out.append("/clock of the recording is not published: the replay has its own")
                continue
            kind = message_class(about.type_name)
            if kind is None or about.serialization != "cdr":
                left_out.append(f"{about.name} is not published: {about.type_name} is not installed")
                continue
            outlets[about.name] = self.publish_on(kind, about.name, profile(about.qos))
        return outlets, left_out

    def start(self) -> None:
        """From the beginning, as soon as somebody listens."""
        self._listeners = Listeners(time.monotonic(), self.settings.wait_for_listener_s)
        self._pace: Pace | None = None
        self._over = False
        self._last_clock = -math.inf

    def close(self) -> None:
        """Close the bag."""
        if self._bag is not None:
            self._bag.close()
            self._bag = None

    def _begin(self) -> None:
        if self._bag is None:
            raise RuntimeError("the bag is closed; configure the node first")
        self._messages: Iterator[Message] = self._bag.messages(list(self._outlets), self._from_ns, self._to_ns)
        self._next: Message | None = next(self._messages, None)
        begin = self._next[0] if self._next is not None else self._from_ns
        rate = self.settings.rate if self.settings.rate > 0.0 else math.inf
        # The first chunk took its time to read; the replay begins now.
        self._pace = Pace(begin, time.monotonic(), rate)
        self._rounds += 1

    def _tick(self) -> None:
        now = time.monotonic()
        pace = self._pace
        if pace is None:
            if not self._over and self._listeners.complete(self._outlets.values(), now):
                self._begin()
            return
        for _ in range(_MOST_PER_TICK):
            if self._next is None or pace.due_s(self._next[0]) > now:
                break
            log_ns, topic, _, data = self._next
            if math.isinf(pace.rate):
                pace.seek(log_ns, now)
            self._tell_time(log_ns, now)
            self._outlets[topic].publish(data)
            self._sent += 1
            self._next = next(self._messages, None)
        if self._next is None and not pace.paused:
            self._end()
        else:
            self._tell_time(pace.position_ns(now), now)

    def _tell_time(self, log_ns: int, now: float) -> None:
        if self._clock_topic is not None and now - self._last_clock >= 1.0 / self.settings.clock_hz:
            self._last_clock = now
            self._clock_topic.publish(Clock(clock=stamp(log_ns)))

    def _end(self) -> None:
        if self.settings.loop and self._sent:
            self.get_logger().info(f"round {self._rounds} is over; begins again")
            self._begin()
            return
        self.get_logger().info(f"published {self._sent} messages")
        self._pace = None
        self._over = True
        self.request_stop()

    def _pause(self, _request: Any, response: Any) -> Any:
        return self._halted(True, response)

    def _resume(self, _request: Any, response: Any) -> Any:
        return self._halted(False, response)

    def _halted(self, halted: bool, response: Any) -> Any:
        now = time.monotonic()
        if self._pace is None:
            response.success, response.message = False, "the replay has not begun"
        elif self._pace.paused == halted:
            response.success, response.message = True, "paused already" if halted else "going on already"
        else:
            (self._pace.pause if halted else self._pace.resume)(now)
            response.success, response.message = True, "paused" if halted else "going on"
        return response

    def findings(self) -> Sequence[Finding]:
        """Progress, and topics that are not published."""
        values = (("messages", str(self._sent)), ("round", str(self._rounds)))
        if self._pace is None:
            return (Finding("replay", OK, "waiting for a listener", values=values),)
        now = time.monotonic()
        late = now - self._pace.due_s(self._next[0]) if self._next is not None and not self._pace.paused else 0.0
        message = "paused" if self._pace.paused else "running"
        found = [Finding("replay", OK, message, values=values)]
        if late > 0.5 and math.isfinite(self._pace.rate):
            found = [Finding("replay", WARN, f"{late:.1f} s behind", "lower the rate", values)]
        if self._left_out:
            found.append(Finding("topics", WARN, "; ".join(self._left_out), "install the packages of their types"))
        return found


def message_class(type_name: str) -> Any:
    """Class of ``package/msg/Name``; None where the package is not installed."""
    package, _, name = type_name.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name, None)
    except (ImportError, ValueError):
        return None


def profile(recorded: str) -> QoSProfile:
    """A profile to publish with that serves whoever the recorded one served."""
    try:
        first = parse_qos(recorded)[0]
    except (ValueError, IndexError):
        return STREAM
    latched = first["durability"] == "transient_local"
    reliable = first["reliability"] == "reliable"
    depth = int(first["depth"]) or STREAM.depth
    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=min(max(depth, 10), 1000),
        reliability=QoSReliabilityPolicy.RELIABLE if reliable else QoSReliabilityPolicy.BEST_EFFORT,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL if latched else QoSDurabilityPolicy.VOLATILE,
    )


def _is_sensor(topic: str) -> bool:
    return any(("/" + topic.strip("/")).endswith("/" + name) for name in wire.SONDE_TOPICS)


def main(args: Sequence[str] | None = None) -> int:
    """Run the replay node."""
    return run_node(ReplayNode, args)
