# SPDX-License-Identifier: Apache-2.0
"""Input topics of the estimator: decode single samples and bursts together, and keep the state of each topic."""

from __future__ import annotations

import collections
import time
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tf2_msgs.msg import TFMessage

from mwd_estimation.core.repeated_samples import RepeatedSamples
from mwd_sensors.core import burst, input_covariance, wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.mount import Mount, MountSettings, Transforms, resolve
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.messages import message_type

_SLOWEST_HZ = 20.0  # smallest sample rate: at 120 r/min the string turns a tenth of a turn from sample to sample
# Number of samples from which the sample rate is computed, number of samples from which the share of lost samples is
# computed, and largest share of lost samples without a warning.
_RATED, _COUNTED, _LOST = 16, 500, 0.03
# Largest difference of the stamps of topics that arrive together, s; and number of blocks in a row with a larger
# difference after which the samples of a topic are not used.
_SKEW_S, _SKEWED = 1.0, 5
# Largest mean distance of the steps between stamps from whole periods, in periods, at which lost samples are counted;
# random steps have 0.25.
_UNEVEN = 0.1
_TIMED = ("imu/mag", "gyro/data_raw")  # topics whose samples are paired with IMU samples
TIMEOUT_S = 2.0  # time without a message after which a topic counts as silent, s
_FULL_S = 10.0  # time for which a full queue is reported, s
_FOREIGN_S = 5.0  # time for which a message in another frame or a second copy of a sample is reported, s

_TYPES = {
    **{topic: wire.SONDE_TOPICS[topic].type_name for topic in ("imu/mag", *burst.TOPICS.values(), "imu/temperature")},
    **dict.fromkeys(burst.TOPICS, burst.TYPE_NAME),
}
# Topic of each unit that has a mount.
_UNITS = {"imu": "imu/data_raw", "mag": "imu/mag", "precision": "gyro/data_raw"}
# Topics whose stated noise is used; the noise of the precision unit is measured at rest.
_NOISY = ("imu/data_raw", "imu/mag")
_BURST_TOPIC = {single: name for name, single in burst.TOPICS.items()}


class InputTopics:
    """Buffered subscriptions to the sonde's topics."""

    def __init__(self, node: GraphNode[Any]) -> None:
        self.frames: dict[str, str] = {}  #: frame id of each topic; messages in another frame are not used
        self.unreadable = 0  #: number of messages that could not be decoded
        self.at_rest = False  #: whether the tool is at rest; the caller sets it from the last attitude
        self._node = node
        self._received_at: dict[str, float] = {}
        # Monotonic time, s, of the last message of each topic in the frame of the topic; and frame and time of the last
        # message in another frame.
        self._frame_at: dict[str, float] = {}
        self._foreign: dict[str, tuple[str, float]] = {}
        # Filter that removes copies of samples (from a second publisher); and monotonic time, s, of the last copy.
        self._repeated = {topic: RepeatedSamples(hold=topic == "imu/data_raw") for topic in _UNITS.values()}
        self._repeated_at: dict[str, float] = {}
        self._covariances: dict[str, dict[str, str]] = {}
        # Topics whose messages state an orientation.
        self._oriented: set[str] = set()
        self._noise = input_covariance.NoiseWatch()
        # Newest stamp of each topic minus the newest stamp of the IMU at that time, ns; and number of times in a row
        # that this difference was too large, with the stamp of the IMU at the last comparison, ns. While no IMU samples
        # arrive, nothing is compared.
        self._imu_ns: int | None = None
        self._skew_ns: dict[str, int] = {}
        self._skewed: dict[str, tuple[int, int]] = {}
        # Monotonic time, s, at which the queue of a topic was last found full.
        self._full_at: dict[str, float] = {}
        self._rates: dict[str, _Rate] = collections.defaultdict(_Rate)
        self._transforms = Transforms()
        self._transforms_seen = 0
        node.add_subscription(TFMessage, "/tf_static", self._on_transforms, qos.EVENT)
        self._buffers = {
            topic: node.add_buffered_subscription(message_type(name), topic, qos.buffered(qos.STREAM))
            for topic, name in _TYPES.items()
        }

    def take(self, topic: str) -> Samples:
        """
        Return the waiting samples of a topic, then the samples of its burst topic, in axes of the sensor unit.

        Samples in a second frame, copies, and samples whose stamps come from another clock are left out.
        """
        layout = wire.SONDE_TOPICS[topic]
        waiting = self._buffers[topic].drain()
        waiting_bursts = self._buffers[_BURST_TOPIC[topic]].drain() if topic in _BURST_TOPIC else []
        if not waiting and not waiting_bursts:
            return layout.empty(0)
        if len(waiting) >= qos.LONG_QUEUE:
            self._full_at[topic] = time.monotonic()
        messages = self._in_frame(topic, [message.data for message in waiting])
        samples, errors = wire.decode_messages(layout, messages)
        bursts = self._in_frame(topic, [message.data for message in waiting_bursts])
        for message in bursts:
            try:
                samples = np.concatenate([samples, burst.decode(message)])
            except wire.WireError as unreadable:
                errors.append(unreadable)
        if messages or bursts:
            self._received_at[topic] = time.monotonic()
        samples = self._fresh(topic, samples)
        if len(samples):
            if topic in _NOISY:
                self._noise.take(samples, layout.type_name)
                self._noise.rest(samples, layout.type_name, self.at_rest)
            samples, notes = input_covariance.judge(samples, layout.type_name)
            self._covariances[topic] = notes
            # The first element of the covariance is -1 where no orientation is stated (sensor_msgs/Imu).
            if "orientation" in (samples.dtype.names or ()) and (samples["orientation_covariance"][:, 0] != -1.0).any():
                self._oriented.add(topic)
            newest_ns = int(samples["stamp_ns"][-1])
            if topic == "imu/data_raw":
                self._imu_ns = newest_ns
            elif self._imu_ns is not None:
                self._follow_skew(topic, newest_ns, self._imu_ns)
            self._rates[topic].add(samples["stamp_ns"])
            if self._is_skewed(topic):
                samples = samples[:0]
        for error in errors:
            self.unreadable += 1
            self._node.get_logger().warning(printable(f"{topic}: {error}"), throttle_duration_sec=10.0)
        return samples

    def _in_frame(self, topic: str, messages: list[bytes]) -> list[bytes]:
        """
        Return the messages of a topic that are in its frame, and messages whose header cannot be read.

        The frame of a topic is the frame of the first message. It changes only if no message in this frame has come for
        `TIMEOUT_S`, because a restarted or exchanged unit may have another frame. A second unit on the topic is not
        used as long as the first unit sends.
        """
        kept, now = [], time.monotonic()
        for message in messages:
            try:
                frame = wire.frame_id(message)
            except wire.WireError:
                kept.append(message)
                continue
            if now - self._frame_at.get(topic, -TIMEOUT_S) >= TIMEOUT_S:
                self.frames[topic] = frame
            if frame == self.frames[topic]:
                self._frame_at[topic] = now
                kept.append(message)
            else:
                self._foreign[topic] = frame, now
        return kept

    def _fresh(self, topic: str, samples: Samples) -> Samples:
        """
        Return the samples without copies (from a second publisher), by the same rule as `mwd process`.

        The time of new copies is stored for the diagnostics.
        """
        repeated = self._repeated.get(topic)
        if repeated is None:
            return samples
        before = repeated.count
        _, fresh = repeated.take(samples["stamp_ns"], samples)
        if repeated.count > before:
            self._repeated_at[topic] = time.monotonic()
        return fresh

    def _follow_skew(self, topic: str, newest_ns: int, imu_ns: int) -> None:
        """Compare the newest stamp of a topic with the newest stamp of the IMU, ns."""
        self._skew_ns[topic] = newest_ns - imu_ns
        count, before_ns = self._skewed.get(topic, (0, 0))
        if imu_ns != before_ns:
            self._skewed[topic] = (count + 1 if abs(newest_ns - imu_ns) > _SKEW_S * 1e9 else 0), imu_ns

    def _is_skewed(self, topic: str) -> bool:
        """Return whether the stamps of a topic are so far from those of the IMU that they come from another clock."""
        return topic in _TIMED and self._skewed.get(topic, (0, 0))[0] >= _SKEWED

    def received(self, topic: str) -> bool:
        """Return whether any message of the topic has arrived."""
        return topic in self._received_at

    def silent(self, topic: str) -> bool:
        """Return whether no message of the topic has arrived for `TIMEOUT_S`."""
        return time.monotonic() - self._received_at.get(topic, -TIMEOUT_S) >= TIMEOUT_S

    @property
    def mount_key(self) -> tuple[Any, ...]:
        """Inputs of `mount` apart from the settings; the mount does not change while they stay the same."""
        return self._transforms_seen, *(self.frames.get(topic) for topic in _UNITS.values())

    @property
    def noise(self) -> dict[str, input_covariance.StatedNoise]:
        """Noise of each vector, as stated by covariances of conventional unit and magnetometer, once it is known."""
        return self._noise.noise

    def mount(self, given: MountSettings) -> Mount:
        """Return the orientation of the units in the tool, from settings, message frames and static transforms."""
        names = {unit: self.frames.get(topic, "") for unit, topic in _UNITS.items()}
        return resolve(given, names, self._transforms)

    def _on_transforms(self, message: TFMessage) -> None:
        for one in message.transforms:
            q = one.transform.rotation
            self._transforms.add(one.header.frame_id, one.child_frame_id, (q.x, q.y, q.z, q.w))
        self._transforms_seen += 1

    def diagnostic(self, topic: str, count: int, level: bytes) -> Diagnostic:
        """Return the diagnostic of one topic; count: number of samples used; level: level while the topic is silent."""
        values: tuple[tuple[str, str], ...] = (("messages", str(count)), ("frame", self.frames.get(topic, "")))
        if not self.silent(topic):
            rate_hz = self._rates[topic].hz
            if 0.0 < rate_hz < _SLOWEST_HZ:
                message = f"rate too low: {rate_hz:.1f} Hz, a turning string needs {_SLOWEST_HZ:g} Hz"
                return Diagnostic(topic, WARN, message, "raise the rate of the unit; surveys at rest go on", values)
            if time.monotonic() - self._full_at.get(topic, -_FULL_S) < _FULL_S:
                message = f"the queue was full ({qos.LONG_QUEUE} samples): older samples may be lost"
                remedy = (
                    "this computer was too slow or paused: stop other programs, or lower the rate of the sensor unit"
                )
                return Diagnostic(topic, WARN, message, remedy, values)
            lost = self._rates[topic].lost
            values = (*values, ("lost_percent", f"{100.0 * lost:.0f}"))
            if lost > _LOST:
                message = f"arriving, but {100.0 * lost:.0f} % of the last samples were lost"
                remedy = "look at the link to the tool and at the load of this machine; the sigmas are widened"
                return Diagnostic(topic, WARN, message, remedy, values)
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
        """Return diagnostics of units with unknown mount: they are not used, or used with the mount of the IMU."""
        found = []
        for words, units in (("not used", mount.unusable), ("assumed to be mounted like the IMU", mount.assumed)):
            for unit, sentence in units.items():
                # Do not report the mount of a unit that sends nothing, except for the IMU.
                if unit == "imu" or self.received(_UNITS[unit]):
                    level = ERROR if units is mount.unusable else WARN
                    what, _, remedy = sentence.partition(": ")
                    found.append(Diagnostic(f"mount of {_UNITS[unit]}", level, f"{words}: {what}", remedy))
        return tuple(found)

    def covariance_diagnostics(self) -> list[Diagnostic]:
        """
        Return diagnostics of covariances and orientations in the messages.

        They report vectors that are declared absent, covariances that are not valid or unknown, and orientations,
        which are not used.
        """
        found = []
        noted = {vector for notes in self._covariances.values() for vector in notes}
        unknown = [name for name, noise in self._noise.noise.items() if noise.sigma == 0.0 and name not in noted]
        if unknown:
            message = f"no covariance is stated for {', '.join(unknown)}: the noise of the tool's settings is used"
            found.append(Diagnostic("unknown covariances", OK, message))
        found += [
            Diagnostic(f"orientation {topic}", OK, f"{topic} states an orientation of its own: it is not used")
            for topic in sorted(self._oriented)
        ]
        for topic, layout in wire.SONDE_TOPICS.items():
            vectors = dict(input_covariance.VECTORS.get(layout.type_name, ())) if topic in _NOISY else {}
            too_small = {vector: note for vector, note in self._noise.not_credible.items() if vector in vectors}
            for vector, note in {**too_small, **self._covariances.get(topic, {})}.items():
                message = input_covariance.sentence(topic, vector, note)
                remedy = "send the covariance, or zeros if the covariance is unknown"
                found.append(Diagnostic(f"covariance {topic} {vector}", WARN, message, remedy))
        return found

    def frame_diagnostics(self) -> list[Diagnostic]:
        """Return diagnostics of topics on which messages in a second frame arrive."""
        now = time.monotonic()
        return [
            Diagnostic(
                f"frame {topic}",
                ERROR,
                f"{topic} comes in frames {self.frames[topic]!r} and {frame!r}: two units publish "
                "this topic, and the samples in the second frame are not used",
                "stop one of the two units, or give each unit its own namespace",
            )
            for topic, (frame, at) in self._foreign.items()
            if frame != self.frames[topic] and now - at < _FOREIGN_S
        ]

    def repeat_diagnostics(self) -> list[Diagnostic]:
        """Return diagnostics of topics whose samples arrive twice."""
        return [
            Diagnostic(
                f"publishers of {topic}",
                WARN,
                f"{topic}: {self._repeated[topic].count} samples came a second time, as from two publishers; the "
                "copies are not used",
                "stop one of the two publishers",
            )
            for topic, at in self._repeated_at.items()
            if time.monotonic() - at < _FOREIGN_S
        ]

    def skew_diagnostics(self) -> list[Diagnostic]:
        """Return diagnostics of topics whose stamps are far from those of the IMU while both arrive."""
        if self.silent("imu/data_raw"):
            return []
        found = []
        for topic in _TIMED:
            skew_s = self._skew_ns.get(topic, 0) * 1e-9
            if self._is_skewed(topic) and not self.silent(topic):
                way = "ahead of" if skew_s > 0.0 else "behind"
                message = f"{topic} is {abs(skew_s):.1f} s {way} imu/data_raw: the two are not used together"
                found.append(Diagnostic(f"time {topic}", ERROR, message, "stamp both topics with one clock"))
        return found


class _Rate:
    """Sample rate of a stream and share of lost samples, from the stamps of the last samples."""

    def __init__(self) -> None:
        self._stamps: collections.deque[int] = collections.deque(maxlen=_COUNTED)

    def add(self, stamp_ns: NDArray[np.int64]) -> None:
        """Add the stamps of samples that arrived, ns."""
        self._stamps.extend(stamp_ns[-_COUNTED:].tolist())

    @property
    def hz(self) -> float:
        """Rate of the last samples, Hz; 0 while it is not known."""
        if len(self._stamps) < _RATED // 2 + 1:
            return 0.0
        recent = list(self._stamps)[-_RATED:]
        if len(set(recent)) < len(recent):
            # Several samples share a stamp: count them over all steps.
            steps = _steps(self._stamps)
            return 1e9 * (len(self._stamps) - 1) / float(steps.sum()) if len(steps) else 0.0
        steps = np.sort(_steps(recent))
        return 1e9 / float(steps[len(steps) // 2]) if len(steps) >= _RATED // 2 else 0.0

    @property
    def lost(self) -> float:
        """Share of the samples that were lost lately, 0 to 1, from gaps between stamps; 0 if unknown."""
        steps = _steps(self._stamps)
        if len(steps) < _COUNTED // 2:
            return 0.0
        # The shortest tenth of the steps are single periods if fewer than nine in ten samples are lost.
        short = float(np.quantile(steps, 0.1))
        period = float(np.median(steps[steps < 1.5 * short]))
        periods = steps / period
        if np.abs(periods - np.round(periods)).mean() > _UNEVEN:
            # With such uneven stamps, missing samples cannot be counted.
            return 0.0
        return 1.0 - len(steps) / float(np.round(periods).sum())


def _steps(stamps: Iterable[int]) -> NDArray[np.int64]:
    """Return the steps between stamps that advance, ns."""
    steps: NDArray[np.int64] = np.diff(np.fromiter(stamps, dtype=np.int64)).astype(np.int64)
    return steps[steps > 0]
