# SPDX-License-Identifier: Apache-2.0
"""Input topics of the estimator: single samples and bursts decoded together, and a record of which topics arrive."""

from __future__ import annotations

import collections
import itertools
import time
from typing import Any

import numpy as np
from mwd_msgs.msg import ImuBurst
from numpy.typing import NDArray
from sensor_msgs.msg import Imu, MagneticField, Temperature
from tf2_msgs.msg import TFMessage

from mwd_sensors.core import burst, input_covariance, wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.mount import Mount, MountSettings, Transforms, resolve
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode

_SLOWEST_HZ = 20.0  # below, a string at 120 r/min turns more than a third of a turn from sample to sample
_RATED = 16  # samples a rate is told from
# Changes of a frame that are followed in a minute; what changes more often comes from two sources.
_MOST_CHANGES, _CHANGES_S = 3, 60.0
_SKEW_S = 1.0  # between topics that arrive together
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
# Topics whose stated noise counts; the precision unit measures its own at rest.
_NOISY = ("imu/data_raw", "imu/mag")
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
    at_rest : bool
        Whether the tool rests, as its user knows.
    """

    def __init__(self, node: GraphNode[Any]) -> None:
        self.frames: dict[str, str] = {}
        self.unreadable = 0
        self.at_rest = False
        self._node = node
        self._received_at: dict[str, float] = {}
        # When the frame of a topic has changed, and to what the last time.
        self._changes: dict[str, tuple[collections.deque[float], str]] = {}
        self._covariances: dict[str, dict[str, str]] = {}
        self._noise = input_covariance.NoiseWatch()
        # Newest stamp of each topic minus that of the IMU when it came, ns.
        self._imu_ns: int | None = None
        self._skew_ns: dict[str, int] = {}
        self._rates: dict[str, _Rate] = collections.defaultdict(_Rate)
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
        samples, errors = wire.decode_messages(layout, messages)
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
        if len(samples):
            self._note_frame(topic, (messages + bursts)[0])
            if topic in _NOISY:
                self._noise.take(samples, layout.type_name)
                self._noise.rest(samples, layout.type_name, self.at_rest)
            samples, notes = input_covariance.judge(samples, layout.type_name)
            self._covariances[topic] = notes
            newest_ns = int(samples["stamp_ns"][-1])
            if topic == "imu/data_raw":
                self._imu_ns = newest_ns
            elif self._imu_ns is not None:
                self._skew_ns[topic] = newest_ns - self._imu_ns
            self._rates[topic].add(samples["stamp_ns"])
        for error in errors:
            self.unreadable += 1
            self._node.get_logger().warning(f"{topic}: {error}", throttle_duration_sec=10.0)
        return samples

    def _note_frame(self, topic: str, message: bytes) -> None:
        """Follow the frame of a topic, which a restarted or exchanged unit may change; not for ever."""
        try:
            frame = wire.frame_id(message)
        except wire.WireError:
            return
        known = self.frames.get(topic)
        if frame == known:
            return
        if known is not None:
            times = self._changes.get(topic, (collections.deque[float](maxlen=_MOST_CHANGES + 1), ""))[0]
            times.append(time.monotonic())
            self._changes[topic] = (times, frame)
        if not self._alternates(topic):
            self.frames[topic] = frame

    def _alternates(self, topic: str) -> bool:
        """Whether the frame of a topic has changed too often in the last minute."""
        if topic not in self._changes:
            return False
        times = self._changes[topic][0]
        return len(times) > _MOST_CHANGES and time.monotonic() - times[0] < _CHANGES_S

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

    @property
    def noise(self) -> dict[str, input_covariance.Noise]:
        """What the covariances of the conventional unit and the magnetometer state, by vector, once it is known."""
        return self._noise.noise

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
        """State of one topic, of which so many samples were taken; level: where it is silent."""
        values = (("messages", str(count)), ("frame", self.frames.get(topic, "")))
        if not self.silent(topic):
            rate_hz = self._rates[topic].hz
            if 0.0 < rate_hz < _SLOWEST_HZ:
                message = f"rate too low: {rate_hz:.1f} Hz, a turning string needs {_SLOWEST_HZ:g} Hz"
                return Diagnostic(topic, WARN, message, "raise the rate of the unit; surveys at rest go on", values)
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
        """Report units whose mount is not known: not used, or taken to be that of the conventional unit."""
        found = []
        for words, units in (("not used", mount.unusable), ("taken in the axes of the IMU", mount.assumed)):
            for unit, sentence in units.items():
                # A unit that never came is reported as such.
                if unit == "imu" or self.received(_UNITS[unit]):
                    level = ERROR if unit == "imu" else WARN
                    what, _, remedy = sentence.partition(": ")
                    found.append(Diagnostic(f"mount of {_UNITS[unit]}", level, f"{words}: {what}", remedy))
        return tuple(found)

    def covariance_diagnostics(self) -> list[Diagnostic]:
        """Name vectors that the messages declare absent, and covariances that are none."""
        found = []
        for topic, layout in wire.SONDE_TOPICS.items():
            vectors = dict(input_covariance.VECTORS.get(layout.type_name, ())) if topic in _NOISY else {}
            too_small = {vector: note for vector, note in self._noise.not_credible.items() if vector in vectors}
            for vector, note in {**too_small, **self._covariances.get(topic, {})}.items():
                message = input_covariance.sentence(topic, vector, note)
                remedy = "give its covariance, or zeros where it is unknown"
                found.append(Diagnostic(f"covariance {topic} {vector}", WARN, message, remedy))
        return found

    def frame_diagnostics(self) -> list[Diagnostic]:
        """Name topics whose messages come in frames that alternate."""
        return [
            Diagnostic(
                f"frame {topic}",
                ERROR,
                f"{topic} comes in frames {self.frames[topic]!r} and {frame!r} in turn: two units publish it",
                "stop one of them, or give each its own namespace",
            )
            for topic, (_, frame) in self._changes.items()
            if self._alternates(topic)
        ]

    def skew_diagnostics(self) -> list[Diagnostic]:
        """Name a topic whose stamps are far from those of the IMU, both arriving."""
        if self.silent("imu/data_raw"):
            return []
        found = []
        for topic in ("imu/mag", "gyro/data_raw"):
            skew_s = self._skew_ns.get(topic, 0) * 1e-9
            if abs(skew_s) > _SKEW_S and not self.silent(topic):
                way = "ahead of" if skew_s > 0.0 else "behind"
                message = f"{topic} is {abs(skew_s):.1f} s {way} imu/data_raw: it is not used together with it"
                found.append(Diagnostic(f"time {topic}", ERROR, message, "stamp both with one clock"))
        return found


class _Rate:
    """Rate of a stream from the stamps of its last samples, Hz; 0 while it is not known."""

    def __init__(self) -> None:
        self._stamps: collections.deque[int] = collections.deque(maxlen=_RATED)

    def add(self, stamp_ns: NDArray[np.int64]) -> None:
        """Take the stamps of samples that arrived."""
        self._stamps.extend(stamp_ns[-_RATED:].tolist())

    @property
    def hz(self) -> float:
        """Rate of the last samples."""
        steps = sorted(later - earlier for earlier, later in itertools.pairwise(self._stamps) if later > earlier)
        return 1e9 / steps[len(steps) // 2] if len(steps) >= _RATED // 2 else 0.0
