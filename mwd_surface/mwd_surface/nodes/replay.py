"""A recording as a node: publishes its bytes again, at their own pace or another, with /clock."""

from __future__ import annotations

import dataclasses
import importlib
import math
import time
from collections.abc import Iterator, Sequence
from typing import Any

from mwd_msgs.srv import SeekReplay, SetReplayRate, StepReplay
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from mwd_estimation.nodes.messages import stamp
from mwd_sensors.core import wire
from mwd_sensors.core.settings import setting
from mwd_sensors.ros.discovery import Listeners
from mwd_sensors.ros.lifecycle_node import OK, WARN, Finding, GraphNode, Later, run_node
from mwd_sensors.ros.qos import STATE, STREAM
from mwd_surface.bags.bag_metadata import parse_qos
from mwd_surface.bags.bag_reader import Bag, BagError, Message
from mwd_surface.bags.pace import Pace

_TICK_S = 0.002
_MOST_PER_TICK = 100  # so that signals and services are heard, and listeners keep up, even when everything is late
_NOT_BEGUN = "the replay has not begun"
_STEP_PER_TICK = 50  # a step knows no pace; listeners must keep up with it


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


@dataclasses.dataclass
class _Step:
    """A step under way: ends after so many messages, or before the first one later than `until_ns`."""

    left: int
    until_ns: int | None
    answer: Later
    published: int = 0


class ReplayNode(GraphNode[ReplaySettings]):
    """Publishes a bag; ends the process with its last message unless it loops."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("replay", ReplaySettings(), **node_options)
        self._bag: Bag | None = None
        self._sent = self._rounds = 0
        self._pace: Pace | None = None
        self._step: _Step | None = None

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
        self.serve(SeekReplay, "~/seek", self._seek)
        self.serve(SetReplayRate, "~/set_rate", self._set_rate)
        self.serve(StepReplay, "~/step", self._begin_step)
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
        self._pace = None
        self._over = False
        self._last_clock = -math.inf

    def halt(self) -> None:
        """Nobody waits for a step that will not end."""
        self._end_step(False, "the replay stops")

    def close(self) -> None:
        """Close the bag."""
        if self._bag is not None:
            self._bag.close()
            self._bag = None

    def _begin(self) -> None:
        rate = self.settings.rate if self.settings.rate > 0.0 else math.inf
        # The first chunk takes its time to read; the replay begins behind it.
        begin = self._go_to(self._from_ns)
        self._pace = Pace(begin, time.monotonic(), rate)
        self._rounds = 1

    def _go_to(self, log_ns: int) -> int:
        """Have the message at or after that moment come next; returns when that one was received, ns."""
        if self._bag is None:
            raise RuntimeError("the bag is closed; configure the node first")
        self._messages: Iterator[Message] = self._bag.messages(list(self._outlets), log_ns, self._to_ns)
        self._next: Message | None = next(self._messages, None)
        return self._next[0] if self._next is not None else log_ns

    def _tick(self) -> None:
        now = time.monotonic()
        pace = self._pace
        if pace is None:
            if not self._over and self._listeners.complete(self._outlets.values(), now):
                self._begin()
            return
        if self._step is not None:
            self._go_on_stepping(self._step, pace, now)
            return
        for _ in range(_MOST_PER_TICK):
            if self._next is None or pace.due_s(self._next[0]) > now:
                break
            if math.isinf(pace.rate):
                pace.seek(self._next[0], now)
            self._tell_time(self._next[0], now)
            self._publish_next()
        if self._next is None and not pace.paused:
            self._end(pace)
        else:
            self._tell_time(pace.position_ns(now), now)

    def _publish_next(self) -> None:
        if self._next is not None:
            _, topic, _, data = self._next
            self._outlets[topic].publish(data)
            self._sent += 1
            self._next = next(self._messages, None)

    def _tell_time(self, log_ns: int, now: float, *, at_once: bool = False) -> None:
        if self._clock_topic is not None and (at_once or now - self._last_clock >= 1.0 / self.settings.clock_hz):
            self._last_clock = now
            self._clock_topic.publish(Clock(clock=stamp(log_ns)))

    def _end(self, pace: Pace) -> None:
        if self.settings.loop and self._sent:
            self.get_logger().info(f"round {self._rounds} is over; begins again")
            pace.seek(self._go_to(self._from_ns), time.monotonic())
            self._rounds += 1
            return
        self.get_logger().info(f"published {self._sent} messages")
        self._pace = None
        self._over = True
        self.request_stop()

    # Services.

    def _pause(self, _request: Any, response: Any) -> Any:
        return self._halted(True, response)

    def _resume(self, _request: Any, response: Any) -> Any:
        return self._halted(False, response)

    def _halted(self, halted: bool, response: Any) -> Any:
        now = time.monotonic()
        if self._pace is None:
            response.success, response.message = False, _NOT_BEGUN
            return response
        self._end_step(False, "paused" if halted else "the replay goes on")
        if self._pace.paused == halted:
            response.success, response.message = True, "paused already" if halted else "going on already"
        else:
            (self._pace.pause if halted else self._pace.resume)(now)
            response.success, response.message = True, "paused" if halted else "going on"
        return response

    def _seek(self, request: SeekReplay.Request, response: SeekReplay.Response) -> SeekReplay.Response:
        if self._pace is None or self._bag is None:
            response.success, response.message = False, _NOT_BEGUN
            return response
        asked = request.time.sec * 10**9 + request.time.nanosec
        if not asked and not (math.isfinite(request.offset) and request.offset >= 0.0):
            response.success, response.message = False, f"offset: must be 0 or more seconds, got {request.offset}"
            return response
        wanted = asked or self._bag.start_ns + round(request.offset * 1e9)
        last = self._to_ns if self._to_ns is not None else self._bag.end_ns
        if not self._from_ns <= wanted <= last:
            first_s, last_s = (round((at - self._bag.start_ns) * 1e-9, 3) for at in (self._from_ns, last))
            response.success = False
            response.message = f"the replay is from {first_s:g} to {last_s:g} s after the first message"
            return response
        self._end_step(False, "the replay went to another moment")
        reached = self._go_to(wanted)
        now = time.monotonic()
        self._pace.seek(reached, now)
        self._tell_time(reached, now, at_once=True)
        response.success, response.time = True, stamp(reached)
        response.message = f"at {(reached - self._bag.start_ns) * 1e-9:.3f} s"
        return response

    def _set_rate(self, request: SetReplayRate.Request, response: SetReplayRate.Response) -> SetReplayRate.Response:
        if self._pace is None:
            response.success, response.message = False, _NOT_BEGUN
        elif not 0.0 < request.rate <= 1000.0:
            response.success, response.message = False, f"rate: must be above 0 and at most 1000, got {request.rate}"
        else:
            self._pace.set_rate(request.rate, time.monotonic())
            response.success, response.message = True, f"{request.rate:g} s of the recording in a second"
        return response

    def _begin_step(self, request: StepReplay.Request, response: StepReplay.Response) -> StepReplay.Response | Later:
        now = time.monotonic()
        if self._pace is None:
            response.success, response.message = False, _NOT_BEGUN
            return response
        if not math.isfinite(request.duration) or request.duration < 0.0:
            response.success, response.message = False, f"duration: must be 0 or more seconds, got {request.duration}"
            return response
        self._end_step(False, "another step began")
        self._pace.pause(now)
        until = self._pace.position_ns(now) + round(request.duration * 1e9) if request.duration > 0.0 else None
        self._step = _Step(max(request.messages, 1), until, Later())
        return self._step.answer

    def _go_on_stepping(self, step: _Step, pace: Pace, now: float) -> None:
        for _ in range(_STEP_PER_TICK):
            if self._next is None or (step.left == 0 if step.until_ns is None else self._next[0] > step.until_ns):
                pace.seek(step.until_ns if step.until_ns is not None else pace.position_ns(now), now)
                self._tell_time(pace.position_ns(now), now, at_once=True)
                self._end_step(True, "the recording is over" if self._next is None else "")
                return
            pace.seek(self._next[0], now)
            self._tell_time(self._next[0], now)
            self._publish_next()
            step.published += 1
            step.left -= step.until_ns is None

    def _end_step(self, success: bool, message: str) -> None:
        step, self._step = self._step, None
        if step is not None and self._pace is not None:
            position = stamp(self._pace.position_ns(time.monotonic()))
            step.answer.answer(
                StepReplay.Response(success=success, message=message, published=step.published, time=position)
            )

    def findings(self) -> Sequence[Finding]:
        """Progress, and topics that are not published."""
        values: tuple[tuple[str, str], ...] = (("messages", str(self._sent)), ("round", str(self._rounds)))
        if self._pace is None:
            return (Finding("replay", OK, "waiting for a listener", values=values),)
        now = time.monotonic()
        if self._bag is not None:
            values += (("position_s", f"{(self._pace.position_ns(now) - self._bag.start_ns) * 1e-9:.3f}"),)
        values += (("rate", f"{self._pace.rate:g}"),)
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
