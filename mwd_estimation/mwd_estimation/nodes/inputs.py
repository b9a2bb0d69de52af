"""Input topics of the estimator: single samples and bursts decoded together, and a record of which topics arrive."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from mwd_msgs.msg import ImuBurst
from sensor_msgs.msg import Imu, MagneticField, Temperature

from mwd_sensors.core import burst, wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import ERROR, OK, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.message_buffer import decode_messages

TIMEOUT_S = 2.0  # without a message before a topic counts as silent

_TYPES = {
    "imu/mag": MagneticField,
    "gyro/data_raw": Imu,
    "gyro/burst": ImuBurst,
    "imu/temperature": Temperature,
    "imu/data_raw": Imu,
    "imu/burst": ImuBurst,
}
_BURST_TOPIC = {single: name for name, single in burst.TOPICS.items()}


class InputTopics:
    """
    Buffered subscriptions to the sonde's topics.

    Attributes
    ----------
    frames : dict
        Frame id of the first message of each topic.
    unreadable : int
        Messages that could not be decoded.
    """

    def __init__(self, node: GraphNode[Any]) -> None:
        self.frames: dict[str, str] = {}
        self.unreadable = 0
        self._node = node
        self._received_at: dict[str, float] = {}
        self._buffers = {
            topic: node.add_buffered_subscription(msg_type, topic, qos.buffered(qos.STREAM))
            for topic, msg_type in _TYPES.items()
        }

    def take(self, topic: str) -> Samples:
        """Take the samples that wait on a topic, followed by those of the burst topic that replaces it."""
        layout = wire.SONDE_TOPICS[topic]
        messages = [message.data for message in self._buffers[topic].take()]
        samples, errors = decode_messages(layout, messages)
        bursts = []
        if topic in _BURST_TOPIC:
            bursts = [message.data for message in self._buffers[_BURST_TOPIC[topic]].take()]
        for message in bursts:
            try:
                samples = np.concatenate([samples, burst.decode(message)])
            except wire.WireError as unreadable:
                errors.append(unreadable)
        if messages or bursts:
            self._received_at[topic] = time.monotonic()
        if topic not in self.frames and len(samples):
            self.frames[topic] = wire.frame_id((messages + bursts)[0])
        for error in errors:
            self.unreadable += 1
            self._node.get_logger().warning(f"{topic}: {error}", throttle_duration_sec=10.0)
        return samples

    def received(self, topic: str) -> bool:
        """Whether any message of the topic has arrived."""
        return topic in self._received_at

    def silent(self, topic: str) -> bool:
        """Whether no message of the topic has arrived for `TIMEOUT_S`."""
        return time.monotonic() - self._received_at.get(topic, -TIMEOUT_S) >= TIMEOUT_S

    def frames_differ(self) -> bool:
        """Whether IMU and magnetometer are published in two frames."""
        imu = self.frames.get("imu/data_raw")
        return imu is not None and imu != self.frames.get("imu/mag", imu)

    def diagnostic(self, topic: str, count: int, level: bytes) -> Diagnostic:
        """
        State of one topic.

        Parameters
        ----------
        count : int
            Samples taken so far.
        level : bytes
            Level where the topic is silent.
        """
        values = (("messages", str(count)), ("frame", self.frames.get(topic, "")))
        if not self.silent(topic):
            return Diagnostic(topic, OK, "arriving", values=values)
        if self.received(topic):
            age = time.monotonic() - self._received_at[topic]
            return Diagnostic(topic, level, f"silent for {age:.0f} s", "is the sonde alive and connected?", values)
        name = self._node.resolve_topic_name(topic)
        publishers = self._node.get_publishers_info_by_topic(name)
        if not publishers:
            return Diagnostic(topic, level, f"nobody publishes {name}", "start the sonde, or remap the topic", values)
        policy = publishers[0].qos_profile.reliability.name
        message = f"{name} has a publisher ({policy}) but nothing arrives"
        return Diagnostic(topic, level, message, "check its QoS", values)

    def frames_diagnostics(self) -> tuple[Diagnostic, ...]:
        """Report an error where IMU and magnetometer are published in two frames, else nothing."""
        if not self.frames_differ():
            return ()
        imu, mag = self.frames["imu/data_raw"], self.frames["imu/mag"]
        message = f"imu/data_raw is in {imu!r}, imu/mag in {mag!r}: the magnetometer is not used"
        return (Diagnostic("frames", ERROR, message, "publish both in one frame"),)
