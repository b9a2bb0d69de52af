"""Input topics of the estimator: single samples and bursts decoded together, and a record of which topics arrive."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from mwd_msgs.msg import ImuBurst
from sensor_msgs.msg import Imu, MagneticField, Temperature
from tf2_msgs.msg import TFMessage

from mwd_sensors.core import burst, wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.mount import Mount, MountSettings, Transforms, resolve
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN, Diagnostic
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
# Topics of the units that a mount turns.
_UNITS = {"imu": "imu/data_raw", "mag": "imu/mag", "precision": "gyro/data_raw"}
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
        self._transforms = Transforms()
        self._transforms_seen = 0
        node.add_subscription(TFMessage, "/tf_static", self._on_transforms, qos.EVENT)
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

    @property
    def mount_key(self) -> tuple[Any, ...]:
        """What `mount` rests on beside the settings: it is the same as long as this is."""
        return self._transforms_seen, *(self.frames.get(topic) for topic in _UNITS.values())

    def mount(self, given: MountSettings) -> Mount:
        """How the units sit in the tool, by the settings, the frames of their messages and the static transforms."""
        names = {unit: self.frames.get(topic, "") for unit, topic in _UNITS.items()}
        return resolve(given, names, self._transforms)

    def _on_transforms(self, message: TFMessage) -> None:
        for one in message.transforms:
            q = one.transform.rotation
            self._transforms.add(one.header.frame_id, one.child_frame_id, (q.x, q.y, q.z, q.w))
        self._transforms_seen += 1

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

    def mount_diagnostics(self, mount: Mount) -> tuple[Diagnostic, ...]:
        """Report units that are not used because their mount is not known; nothing where all of them are."""
        found = []
        for unit, sentence in mount.unusable.items():
            # A unit that never came is reported as such.
            if unit == "imu" or self.received(_UNITS[unit]):
                level = ERROR if unit == "imu" else WARN
                what, _, remedy = sentence.partition(": ")
                found.append(Diagnostic(f"mount of {_UNITS[unit]}", level, f"not used: {what}", remedy))
        return tuple(found)
