# SPDX-License-Identifier: Apache-2.0
"""
The estimate begins with samples that the recorder has too, so that a recording gives the same results again.

Subscriptions to one topic are matched one after the other: the estimator may receive samples that the recorder does not
receive yet. Until the recorder has told the first stamp of each topic, samples wait; earlier ones are not used.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from mwd_msgs.msg import RecorderStatus, SampleCount

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.ros import qos
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.time_stamps import stamp

# Longest wait for the recorder, s: it tells its state once a second, and at once when a topic begins to arrive.
_LONGEST_S = 5.0
# Samples of a topic that wait at most, of a unit of 1 kHz for a minute.
_MOST = 60_000


class SampleCounts:
    """Samples that were used, by topic."""

    def __init__(self) -> None:
        self._counts: dict[str, tuple[int, int, int]] = {}

    def take(self, topic: str, samples: Samples) -> None:
        """Count samples, which are not none."""
        stamps = samples["stamp_ns"]
        low, high = int(stamps.min()), int(stamps.max())
        first, last, count = self._counts.get(topic, (low, high, 0))
        self._counts[topic] = min(first, low), max(last, high), count + len(samples)

    @property
    def newest_ns(self) -> int:
        """Newest stamp of the IMU, ns; 0 before the first sample."""
        return self._counts.get("imu/data_raw", (0, 0, 0))[1]

    def messages(self, full_name: Callable[[str], str]) -> list[SampleCount]:
        """Return the counts as messages; full_name resolves the name of a topic."""
        return [
            SampleCount(topic=full_name(topic), first=stamp(first), last=stamp(last), samples=count)
            for topic, (first, last, count) in self._counts.items()
        ]


class RecordingGate:
    """
    Holds the first samples back until they are in the recording, where one is being made.

    node: the estimator, whose subscription to `recorder` is opened.
    """

    def __init__(self, node: GraphNode[Any]) -> None:
        self._node = node
        self._open = False
        self._waiting: dict[str, Samples] = {}
        self._since: float | None = None
        # Full name of each recorded topic of samples, with the first stamp, ns; 0: none came. None: not told yet.
        self._first_ns: dict[str, int] | None = None
        node.add_subscription(RecorderStatus, "recorder", self._on_status, qos.STATE)

    def _on_status(self, message: RecorderStatus) -> None:
        names = message.streams if message.state == RecorderStatus.RECORDING else []
        stamps = [one.sec * wire.NANOSECONDS + one.nanosec for one in message.first]
        self._first_ns = dict(zip(names, stamps, strict=False))

    def passed(self, taken: Mapping[str, Samples]) -> dict[str, Samples]:
        """Return the samples to be used now, by topic, out of those that were received since the last call."""
        if self._open:
            return dict(taken)
        for topic, samples in taken.items():
            held = self._waiting.get(topic, samples[:0])
            self._waiting[topic] = np.concatenate([held, samples])[-_MOST:]
        if not any(len(samples) for samples in self._waiting.values()):
            return dict(taken)
        now = time.monotonic()
        self._since = now if self._since is None else self._since
        begin_ns, lacking = self._recorded_from()
        if lacking and now - self._since < _LONGEST_S:
            return {topic: samples[:0] for topic, samples in taken.items()}
        if lacking:
            names = ", ".join(lacking)
            text = f"the recorder receives nothing of {names}: the recording will lack samples that are used"
            self._node.get_logger().warning(printable(text))
        self._open = True
        waiting, self._waiting = self._waiting, {}
        return {topic: samples[samples["stamp_ns"] >= begin_ns.get(topic, 0)] for topic, samples in waiting.items()}

    def _recorded_from(self) -> tuple[dict[str, int], list[str]]:
        """Return the first recorded stamp of each topic that arrives, ns, and the topics that the recording lacks."""
        if self._first_ns is None:
            recorder = self._node.resolve_topic_name("recorder")
            # Nobody records, or the first message of the recorder is still to come.
            return {}, [recorder] if self._node.count_publishers(recorder) else []
        begin_ns, lacking = {}, []
        for topic, samples in self._waiting.items():
            name = self._node.resolve_topic_name(topic)
            if len(samples) and name in self._first_ns:
                begin_ns[topic] = self._first_ns[name]
                lacking += [name] if not self._first_ns[name] else []
        return begin_ns, lacking
