# SPDX-License-Identifier: Apache-2.0
"""Replay node: publishes the messages of a recording again, at the original or another rate, with /clock."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from mwd_msgs.srv import SeekReplay, SetReplayRate, StepReplay
from rclpy.duration import Duration
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from mwd_sensors.core import wire
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.core.settings import setting
from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.ros.deferred import DeferredResponse, answering
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.discovery import SubscriberDiscovery
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.qos import LONG_QUEUE, STATE, STREAM, buffered
from mwd_sensors.ros.run_node import run_node
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.bags.bag_metadata import parse_qos
from mwd_surface.bags.bag_reader import Bag, BagError, Message, TopicInfo
from mwd_surface.bags.definitions import is_ours
from mwd_surface.bags.pace import Pace
from mwd_surface.bags.topic_info import REMEDY
from mwd_surface.ros.topics import message_class

_TIMER_PERIOD = 0.002  # time between two timer callbacks, s
# Largest number of messages per timer callback, so that services respond and subscribers keep up after a delay.
_MAX_PER_CALLBACK = 100
_MAX_PER_STEP_CALLBACK = 50  # messages; smaller, because a step publishes without pauses and subscribers must keep up
_SAY_EVERY_S = 10.0  # time between two log lines on the progress, s
_MOST_LATCHED = 1000  # largest depth of a latched topic; used for a recorded depth of 0, which means no limit
_FOREVER_S = 9e9  # a longer recorded duration, s, stands for "no limit"


@dataclasses.dataclass(frozen=True)
class ReplaySettings:
    """Parameters of the replay node."""

    bag: str = setting("", "Recording to publish: its folder, or its .mcap or .db3 file.")
    rate: float = setting(
        1.0,
        "Seconds of the recording per second of wall time; 0: as fast as possible. Subscribers lose samples at a "
        "rate they cannot follow.",
        low=0.0,
        high=1000.0,
    )
    loop: bool = setting(False, "Start again from the beginning when the end is reached.")
    start_s: float = setting(0.0, "Start this long after the first message.", low=0.0)
    end_s: float = setting(0.0, "End this long after the first message; 0: at the last message.", low=0.0)
    topics: list[str] = setting([], "Topics to publish; empty: all.")
    sensors_only: bool = setting(
        False,
        "Publish only the topics of sonde and rig, so that estimator and surface can run together with the replay.",
    )
    clock_hz: float = setting(100.0, "Rate of /clock in wall time; 0: no /clock.", low=0.0, high=1000.0)
    wait_for_listener_s: float = setting(
        3.0, "Longest wait for subscribers before the first message; 0: start at once.", low=0.0, high=600.0
    )


@dataclasses.dataclass
class _Step:
    """Running step: it ends after `remaining` messages, or before the first message later than `until_ns`."""

    remaining: int
    until_ns: int | None
    response: DeferredResponse
    published: int = 0


class ReplayNode(GraphNode[ReplaySettings]):
    """Node that publishes a recording; the process ends with the last message unless `loop` is set."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("replay", ReplaySettings(), **node_options)
        self._bag: Bag | None = None
        self._published = self._rounds = 0
        self._pace: Pace | None = None
        self._step: _Step | None = None
        self._said_at = 0.0

    def configure(self) -> None:
        """
        Open the bag and a publisher for each topic to publish.

        Raises
        ------
        ValueError
            No bag is given, it cannot be read, or `published_topics` refuses it.
        """
        settings = self.settings
        if not settings.bag:
            raise ValueError("bag: is empty; give the recording to publish")
        try:
            self._bag = Bag(settings.bag)
            self._from_ns = self._bag.start_ns + round(settings.start_s * 1e9)
            self._to_ns = self._bag.start_ns + round(settings.end_s * 1e9) if settings.end_s > 0.0 else None
            chosen, self._left_out = published_topics(self._bag, settings)
        except BagError as error:
            raise ValueError(str(error)) from error
        self._topic_publishers = {
            about.name: self.add_publisher(message_class(about.type_name), about.name, profile(about.qos))
            for about in chosen
        }
        for sentence in (*self._bag.notes, *self._left_out):
            self.get_logger().warning(printable(sentence))
        self._clock_publisher = self.add_publisher(Clock, "/clock", STATE) if settings.clock_hz > 0.0 else None
        self.add_service(Trigger, "~/pause", self._on_pause)
        self.add_service(Trigger, "~/resume", self._on_resume)
        self.add_service(SeekReplay, "~/seek", self._on_seek)
        self.add_service(SetReplayRate, "~/set_rate", self._on_set_rate)
        self.add_service(StepReplay, "~/step", self._on_step)
        self.add_timer(_TIMER_PERIOD, self._on_timer)

    def activate(self) -> None:
        """Start from the beginning once there are subscribers, or after `wait_for_listener_s`."""
        self._discovery = SubscriberDiscovery(time.monotonic(), self.settings.wait_for_listener_s)
        self._pace = None
        self._over = False
        self._last_clock = -math.inf

    def deactivate(self) -> None:
        """End a running step, and answer its request with a failure."""
        self._end_step(False, "the replay stops")

    def cleanup(self) -> None:
        """Close the bag."""
        if self._bag is not None:
            self._bag.close()
            self._bag = None

    def _start(self) -> None:
        rate = self.settings.rate if self.settings.rate > 0.0 else math.inf
        # Start the pace after the first message has been read, because reading the first chunk takes time.
        begin = self._go_to(self._from_ns)
        self._pace = Pace(begin, time.monotonic(), rate)
        self._rounds = 1
        self._said_at = time.monotonic()

    def _go_to(self, log_ns: int) -> int:
        """
        Continue with the first message recorded at or after `log_ns`.

        Return the time of recording of this message, ns, or `log_ns` if no message follows.
        """
        if self._bag is None:
            raise RuntimeError("the bag is closed; configure the node first")
        self._messages: Iterator[Message] = self._bag.messages(list(self._topic_publishers), log_ns, self._to_ns)
        self._next: Message | None = next(self._messages, None)
        return self._next[0] if self._next is not None else log_ns

    def _on_timer(self) -> None:
        now = time.monotonic()
        pace = self._pace
        if pace is None:
            if not self._over and self._discovery.complete(self._topic_publishers.values(), now):
                self._start()
            return
        if self._step is not None:
            self._continue_step(self._step, pace, now)
            return
        for _ in range(_MAX_PER_CALLBACK):
            if self._next is None or pace.due_s(self._next[0]) > now:
                break
            if math.isinf(pace.rate):
                pace.seek(self._next[0], now)
            self._publish_clock(self._next[0], now)
            self._publish_next()
        if self._said_at + _SAY_EVERY_S <= now and self._bag is not None:
            self._said_at = now
            at_s, all_s = (pace.position_ns(now) - self._bag.start_ns) * 1e-9, self._bag.duration_s
            self.get_logger().info(printable(f"at {min(at_s, all_s):.0f} of {all_s:.0f} s"))
        if self._next is None and not pace.paused:
            self._end(pace)
        else:
            self._publish_clock(pace.position_ns(now), now)

    def _publish_next(self) -> None:
        if self._next is not None:
            _, topic, _, data = self._next
            self._topic_publishers[topic].publish(data)
            self._published += 1
            self._next = next(self._messages, None)

    def _publish_clock(self, log_ns: int, now: float, *, immediately: bool = False) -> None:
        if self._clock_publisher is not None and (
            immediately or now - self._last_clock >= 1.0 / self.settings.clock_hz
        ):
            self._last_clock = now
            self._clock_publisher.publish(Clock(clock=stamp(log_ns)))

    def _end(self, pace: Pace) -> None:
        if self.settings.loop and self._published:
            self.get_logger().info(printable(f"round {self._rounds} is over; the replay begins again"))
            pace.seek(self._go_to(self._from_ns), time.monotonic())
            self._rounds += 1
            return
        self.get_logger().info(printable(f"published {self._published} messages"))
        self._pace = None
        self._over = True
        self.request_stop()

    # Services.

    def _started(self) -> tuple[Pace, Bag]:
        if self._pace is None or self._bag is None:
            raise ValueError("the replay has not begun")
        return self._pace, self._bag

    @answering
    def _on_pause(self, _request: Trigger.Request, _response: Trigger.Response) -> str:
        pace, _ = self._started()
        self._end_step(False, "paused")
        if pace.paused:
            return "paused already"
        pace.pause(time.monotonic())
        return "paused"

    @answering
    def _on_resume(self, _request: Trigger.Request, _response: Trigger.Response) -> str:
        pace, _ = self._started()
        self._end_step(False, "the replay continues")
        if not pace.paused:
            return "the replay is running already"
        pace.resume(time.monotonic())
        return "the replay continues"

    @answering
    def _on_seek(self, request: SeekReplay.Request, response: SeekReplay.Response) -> str:
        pace, bag = self._started()
        asked = stamp_of(request.time)
        if not asked and not (math.isfinite(request.offset) and request.offset >= 0.0):
            raise ValueError(f"offset: must be 0 or more seconds, got {request.offset}")
        wanted = asked or bag.start_ns + round(request.offset * 1e9)
        last = self._to_ns if self._to_ns is not None else bag.end_ns
        if not self._from_ns <= wanted <= last:
            first_s, last_s = (round((at - bag.start_ns) * 1e-9, 3) for at in (self._from_ns, last))
            raise ValueError(f"the replay is from {first_s:g} to {last_s:g} s after the first message")
        self._end_step(False, "the replay was moved to another time")
        reached = self._go_to(wanted)
        now = time.monotonic()
        pace.seek(reached, now)
        self._publish_clock(reached, now, immediately=True)
        response.time = stamp(reached)
        return f"at {(reached - bag.start_ns) * 1e-9:.3f} s"

    @answering
    def _on_set_rate(self, request: SetReplayRate.Request, _response: SetReplayRate.Response) -> str:
        pace, _ = self._started()
        if not 0.0 < request.rate <= 1000.0:
            raise ValueError(f"rate: must be above 0 and at most 1000, got {request.rate}")
        pace.set_rate(request.rate, time.monotonic())
        return f"{request.rate:g} s of the recording in a second"

    @answering
    def _on_step(self, request: StepReplay.Request, _response: StepReplay.Response) -> DeferredResponse:
        (pace, _), now = self._started(), time.monotonic()
        if not math.isfinite(request.duration) or request.duration < 0.0:
            raise ValueError(f"duration: must be 0 or more seconds, got {request.duration}")
        self._end_step(False, "another step began")
        pace.pause(now)
        until = pace.position_ns(now) + round(request.duration * 1e9) if request.duration > 0.0 else None
        self._step = _Step(max(request.messages, 1), until, DeferredResponse())
        return self._step.response

    def _continue_step(self, step: _Step, pace: Pace, now: float) -> None:
        for _ in range(_MAX_PER_STEP_CALLBACK):
            if self._next is None or (step.remaining == 0 if step.until_ns is None else self._next[0] > step.until_ns):
                pace.seek(step.until_ns if step.until_ns is not None else pace.position_ns(now), now)
                self._publish_clock(pace.position_ns(now), now, immediately=True)
                self._end_step(True, "the recording is over" if self._next is None else "")
                return
            pace.seek(self._next[0], now)
            self._publish_clock(self._next[0], now)
            self._publish_next()
            step.published += 1
            step.remaining -= step.until_ns is None

    def _end_step(self, success: bool, message: str) -> None:
        step, self._step = self._step, None
        if step is not None and self._pace is not None:
            position = stamp(self._pace.position_ns(time.monotonic()))
            step.response.send(
                StepReplay.Response(success=success, message=message, published=step.published, time=position)
            )

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Return a diagnostic of the progress and, once the replay runs, one of the topics that are not published."""
        values: tuple[tuple[str, str], ...] = (("messages", str(self._published)), ("round", str(self._rounds)))
        if self._pace is None:
            over = "the replay has ended; it waits until subscribers have acknowledged the last messages"
            message = over if self._over else "waiting for a listener"
            return (Diagnostic("replay", OK, message, values=(*values, wire.OVER) if self._over else values),)
        now = time.monotonic()
        if self._bag is not None:
            values += (("position_s", f"{(self._pace.position_ns(now) - self._bag.start_ns) * 1e-9:.3f}"),)
        values += (("rate", f"{self._pace.rate:g}"),)
        late = now - self._pace.due_s(self._next[0]) if self._next is not None and not self._pace.paused else 0.0
        message = "paused" if self._pace.paused else "running"
        found = [Diagnostic("replay", OK, message, values=values)]
        if late > 0.5 and math.isfinite(self._pace.rate):
            found = [Diagnostic("replay", WARN, f"{late:.1f} s behind", "lower the rate", values)]
        if self._left_out:
            remedy = "install the packages of their types, in the version of the recording"
            found.append(Diagnostic("topics", WARN, "; ".join(self._left_out), remedy))
        return found


def published_topics(bag: Bag, settings: ReplaySettings) -> tuple[list[TopicInfo], list[str]]:
    """
    Return the topics of a bag that a replay publishes, and sentences about topics that cannot be published.

    Topics that the settings do not select are in neither list.

    Raises
    ------
    BagError
        The bag lacks a requested topic, or no topic can be published here.
    """
    chosen, left_out = [], []
    asked = set(settings.topics)
    unread = [bag.unreadable[name].described() for name in sorted(asked & bag.unreadable.keys())]
    if unread:
        raise BagError(f"{bag.path}: {'; '.join(unread)}", REMEDY)
    unknown = asked - bag.topics.keys()
    if unknown:
        raise BagError(f"{bag.path} has no topic {', '.join(sorted(unknown))}", f"it has {', '.join(bag.topics)}")
    for about in bag.topics.values():
        if (asked and about.name not in asked) or (settings.sensors_only and not _is_sensor(about.name)):
            continue
        if about.name == "/clock" and settings.clock_hz > 0.0:
            left_out.append("/clock of the recording is not published: the replay has its own")
        elif message_class(about.type_name) is None:
            left_out.append(f"{about.name} is not published: {about.type_name} is not installed")
        elif not is_ours(about.type_name, about.type_hash, ""):
            why = f"it was recorded with another definition of {about.type_name}"
            left_out.append(f"{about.name} is not published: {why}")
        else:
            chosen.append(about)
    left_out += [f"{one.described()}; it is not published" for one in bag.unreadable.values() if one.count]
    if not chosen:
        why = "; ".join(left_out) or "sonde and rig publish none of its topics"
        raise BagError(f"{bag.path} has no topic that can be published here: {why}")
    return chosen, left_out


def profile(recorded: str) -> QoSProfile:
    """
    Return the QoS profile to publish a topic with: every subscriber of the recorded topic can receive from it.

    recorded: QoS profiles of the recorded publishers, as YAML in the recording. A publisher discards messages that
    exceed its depth, even if a subscriber has not acknowledged them, and a replay publishes faster than the sensor: the
    depth is therefore `LONG_QUEUE`. A latched topic gets the recorded depth (at least 10), because the depth determines
    the messages that late subscribers receive. If `recorded` cannot be read, the profile of a stream is used.
    """
    try:
        first = parse_qos(recorded)[0]
        deadline, lease = (_duration(first[name]) for name in ("deadline", "liveliness_lease_duration"))
        depth = int(first["depth"]) or _MOST_LATCHED
    except (ValueError, IndexError, TypeError, KeyError):
        return buffered(STREAM)
    latched = first["durability"] == "transient_local"
    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=min(max(depth, 10), _MOST_LATCHED) if latched else LONG_QUEUE,
        reliability=QoSReliabilityPolicy.RELIABLE,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL if latched else QoSDurabilityPolicy.VOLATILE,
        deadline=deadline,
        liveliness_lease_duration=lease,
    )


def _duration(recorded: Mapping[str, Any]) -> Duration:
    """Return a recorded duration; the middleware's value for "infinite" becomes 0, which means no limit."""
    seconds = float(recorded["sec"]) + float(recorded["nsec"]) / NANOSECONDS
    return Duration(seconds=seconds if 0.0 <= seconds < _FOREVER_S else 0.0)


def _is_sensor(topic: str) -> bool:
    return any(("/" + topic.strip("/")).endswith("/" + name) for name in wire.SONDE_TOPICS)


def main(args: Sequence[str] | None = None) -> int:
    """Run the replay node; return the exit status of the process."""
    return run_node(ReplayNode, args)
