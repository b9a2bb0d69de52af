# SPDX-License-Identifier: Apache-2.0
"""
Middleware problems of a node: incompatible quality of service, more than one publisher, a second node of the same name.

The middleware reports each problem only once, and an incompatible pair silently exchanges nothing. Here the problems
stay in the diagnostics, with names and a remedy, until the cause is gone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.duration import Duration, Infinite
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible

from mwd_sensors.ros.diagnostics import ERROR, Diagnostic

# Time for which a topic may have two publishers, s: a process that is replaced by another ends a little later.
_SEVERAL_S = 3.0
# Time after which a second node or publisher of the same name is reported, s: a killed process stays in the graph of
# the middleware until its lease ends (Fast DDS: 20 s).
_SAME_NAME_S = 25.0
# Topics with several publishers in a well: all nodes publish heartbeats, and all nodes with services for people publish
# operator events.
SHARED = ("heartbeat", "operator_events")


class MiddlewareEvents:
    """
    Collects the events of one node's subscriptions and publishers.

    Parameters
    ----------
    clock : callable
        Returns steady time, s.
    """

    def __init__(self, node: Any, clock: Callable[[], float] = time.monotonic) -> None:
        self._node, self._clock = node, clock
        self._incompatible: dict[tuple[str, bool], QoSProfile] = {}
        self._several: dict[str, float] = {}
        self._twice_since: float | None = None

    def of_subscription(self, topic: str, qos: QoSProfile) -> SubscriptionEventCallbacks:
        """Return the callbacks that note an incompatible profile and several publishers of a subscription."""

        def matched(event: Any) -> None:
            # Topics outside the well, such as /diagnostics, have many publishers.
            if topic.startswith("/") or topic in SHARED or event.current_count < 2:
                self._several.pop(topic, None)
            else:
                self._several.setdefault(topic, self._clock())

        def incompatible(_event: Any) -> None:
            self._incompatible[topic, True] = qos

        return SubscriptionEventCallbacks(incompatible_qos=incompatible, matched=matched)

    def of_publisher(self, topic: str, qos: QoSProfile) -> PublisherEventCallbacks:
        """Return the event callbacks of a publisher."""

        def incompatible(_event: Any) -> None:
            self._incompatible[topic, False] = qos

        return PublisherEventCallbacks(incompatible_qos=incompatible)

    def diagnostics(self) -> list[Diagnostic]:
        """
        Return an error for each problem that lasts.

        Problems are topics with an incompatible partner, topics with several publishers, and a second node of the same
        name.
        """
        found = self._second_node()
        for (topic, receives), qos in list(self._incompatible.items()):
            others = self._unfit(topic, receives, qos)
            if others:
                verb = "receives nothing from" if receives else "cannot send to"
                message = f"{topic}: this node {verb} {'; '.join(others)}; its own profile is {_words(qos)}"
                found.append(Diagnostic(f"middleware {topic}", ERROR, message, "give both the same QoS profile"))
            else:
                del self._incompatible[topic, receives]
        return found + [self._named(topic) for topic in self._several if self._lasting(topic)]

    def _second_node(self) -> list[Diagnostic]:
        """
        Return an error if another node has had the same name for `_SAME_NAME_S`; else an empty list.

        Two nodes of one name answer the same requests.
        """
        own = f"{self._node.get_namespace().rstrip('/')}/{self._node.get_name()}"
        every = self._node.get_node_names_and_namespaces()
        count = sum(f"{space.rstrip('/')}/{name}" == own for name, space in every)
        if count < 2:
            self._twice_since = None
            return []
        if self._twice_since is None:
            self._twice_since = self._clock()
        if self._clock() - self._twice_since < _SAME_NAME_S:
            return []
        message = f"{count} nodes have the name {own}: each of them answers requests to it"
        return [Diagnostic("middleware node", ERROR, message, "stop all but one, or give each well its own namespace")]

    def _unfit(self, topic: str, receives: bool, qos: QoSProfile) -> list[str]:
        name = self._node.resolve_topic_name(topic)
        infos = self._node.get_publishers_info_by_topic if receives else self._node.get_subscriptions_info_by_topic
        unfit = []
        for info in infos(name):
            pair = (info.qos_profile, qos) if receives else (qos, info.qos_profile)
            if not _compatible(*pair):
                unfit.append(f"{_node_of(info)} ({_words(info.qos_profile)})")
        return unfit

    def _publishers(self, topic: str) -> list[str]:
        name = self._node.resolve_topic_name(topic)
        return sorted(_node_of(info) for info in self._node.get_publishers_info_by_topic(name))

    def _lasting(self, topic: str) -> bool:
        names = self._publishers(topic)
        wait_s = _SAME_NAME_S if len(set(names)) < 2 else _SEVERAL_S
        return len(names) > 1 and self._clock() - self._several[topic] >= wait_s

    def _named(self, topic: str) -> Diagnostic:
        names = self._publishers(topic)
        message = f"{topic} has {len(names)} publishers: {', '.join(names)}"
        return Diagnostic(
            f"middleware {topic}", ERROR, message, "stop all but one, or give each well its own namespace"
        )


def _node_of(info: Any) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def _compatible(publisher: QoSProfile, subscription: QoSProfile) -> bool:
    """Return whether the middleware connects a publisher and a subscription with these profiles."""
    return bool(qos_check_compatible(_plain(publisher), _plain(subscription))[0] != QoSCompatibility.ERROR)


def _plain(qos: QoSProfile) -> QoSProfile:
    """
    Return a profile with only those properties that decide whether the middleware connects; omit unlimited durations.

    An unlimited duration is infinite in the middleware's graph but 0 in a profile. rclpy treats the two as different,
    so every healthy partner would count as incompatible.
    """
    limited = {name: getattr(qos, name) for name in _DURATIONS if _is_limited(getattr(qos, name))}
    return QoSProfile(
        depth=1, reliability=qos.reliability, durability=qos.durability, liveliness=qos.liveliness, **limited
    )


_DURATIONS = ("deadline", "liveliness_lease_duration")


def _is_limited(duration: Duration) -> bool:
    return bool(0 < duration.nanoseconds < Infinite.nanoseconds)


def _words(qos: QoSProfile) -> str:
    words = [qos.reliability.name, qos.durability.name]
    words += [
        f"{name} {getattr(qos, name).nanoseconds * 1e-9:g} s" for name in _DURATIONS if _is_limited(getattr(qos, name))
    ]
    return ", ".join(words).lower().replace("_", " ")
