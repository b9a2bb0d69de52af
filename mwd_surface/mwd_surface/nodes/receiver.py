# SPDX-License-Identifier: Apache-2.0
"""Receiver node: receives pressure, voltage or bytes; publishes words, frames, surveys, logs, attitude, quality."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mwd_msgs import msg
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.nodes.diagnostics import reference_diagnostic
from mwd_estimation.settings.place import reference_of
from mwd_estimation.survey.survey import Survey
from mwd_estimation.survey.tool_code import reference_for, sensor_errors
from mwd_sensors.core import gauge_burst, wire
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.message_buffer import MessageBuffer, ReceivedMessage
from mwd_sensors.ros.messages import make
from mwd_sensors.ros.run_node import run_node
from mwd_sensors.telemetry import on_air, tool_commands, tool_configuration
from mwd_sensors.telemetry.downlink import COMMANDS, DownlinkFrame
from mwd_sensors.telemetry.pulse_position import PULSE_TU
from mwd_sensors.telemetry.serial_frames import BITS_PER_BYTE
from mwd_sensors.telemetry.tool_commands import ToolSettings
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, encode
from mwd_surface.nodes.receiver_settings import ReceiverSettings
from mwd_surface.receiver.link import link_attitude
from mwd_surface.receiver.link.link import LOCKED, NO_FLOW, NO_INPUT, LinkOutput, Quality
from mwd_surface.receiver.link.link_feed import LinkFeed
from mwd_surface.receiver.link.link_log import log_samples, survey_samples
from mwd_surface.receiver.link.link_survey import LinkSurveys
from mwd_surface.receiver.link.receivers import receiver_of
from mwd_surface.receiver.sampled_receiver import SampledReceiver
from mwd_surface.receiver.sources import SerialBytes
from mwd_surface.ros import link_messages

_PERIOD_S = 0.05  # time between two calls that process the arrived messages, s
_SILENT_S = 5.0  # time without a burst after which an input is silent, s
_QUALITY_S, _ATTITUDE_S = 1.0, 0.5  # time between two messages on the quality, and on the attitude, s
_WAVE_SPEED = 1250.0  # speed of pressure waves in mud (Korteweg), m/s, for the age of a word
_DEEPEST_M = 20_000.0  # depth that no hole exceeds, m
_TURNING = 0.5  # speed of the top drive below which the string counts as sliding, rad/s
_TYPES: dict[str, Any] = {
    gauge_burst.PRESSURE: msg.PressureBurst,
    gauge_burst.VOLTAGE: msg.VoltageBurst,
    gauge_burst.SERIAL: msg.SerialBurst,
}


@dataclasses.dataclass
class _Input:
    """One link: feed, waiting bursts and their type, time of the last burst, and time of the last published state."""

    feed: LinkFeed
    buffer: MessageBuffer | None
    kind: str
    received_at: float = -np.inf
    published_quality: float = -np.inf

    @property
    def silent(self) -> bool:
        """Whether no burst has arrived for `_SILENT_S`."""
        return time.monotonic() - self.received_at > _SILENT_S


class ReceiverNode(GraphNode[ReceiverSettings]):
    """Node that decodes the telemetry; it subscribes only to measurements of the rig, never to topics of the tool."""

    changeable = ("place.", "verdict.")

    def __init__(self, **node_options: Any) -> None:
        super().__init__("receiver", ReceiverSettings(), **node_options)
        self._line: SerialBytes | None = None

    def configure(self) -> None:
        """
        Read the tool configurations, compile the kernels and open the topics.

        Raises
        ------
        RuntimeError
            A tool configuration is missing or cannot be read, the tool code is unknown, or a serial port is set without
            a wired tool.
        """
        settings = self.settings
        if not settings.tool_file:
            raise RuntimeError("tool_file: a receiver needs the tool configuration; `mwd tool new` writes one")
        files = [file for file in (settings.tool_file, settings.second_tool_file) if file]
        try:
            self._tools = tool_configuration.read_several(Path(file).expanduser() for file in files)
            self._errors = sensor_errors(settings.tool_code) if settings.tool_code else None
        except (ValueError, OSError) as error:
            raise RuntimeError(str(error)) from error
        self.prepare(lambda: warm_up(self._tools))
        self._line = self._serial_line()
        self._inputs: list[_Input] = []
        buffers = [self._buffer(tool.link) for tool in self._tools]
        self._begin(buffers)
        self._strokes: MessageBuffer | None = None
        if "mud_pulse" in (tool.link for tool in self._tools):
            self._strokes = self.add_buffered_subscription(msg.StrokeBurst, "rig/strokes", qos.buffered(qos.EVENT))
        self.add_subscription(msg.RigState, "rig/state", self._on_rig_state, qos.EVENT)
        self.add_subscription(JointState, "rig/quill", self._on_quill, qos.STATE)
        if any(tool.downlink is not None for tool in self._tools):
            self.add_subscription(msg.DownlinkState, "downlink/state", self._on_downlink, qos.EVENT)
        self._word = self.add_publisher(msg.LinkWord, "link/word", qos.EVENT)
        self._frame_publisher = self.add_publisher(msg.LinkFrame, "link/frame", qos.EVENT)
        # A backlog of pressure gives many states at once. No state may be lost, because states report missed surveys.
        self._quality = self.add_publisher(msg.LinkQuality, "link/quality", qos.buffered(qos.STATE))
        self._attitude = self.add_publisher(msg.Attitude, "link/attitude", qos.STATE)
        self._survey = self.add_publisher(msg.Survey, "link/survey", qos.EVENT)
        self._log = self.add_publisher(msg.LogSample, "link/log", qos.EVENT)
        self.add_timer(_PERIOD_S, self._on_timer)

    def _serial_line(self) -> SerialBytes | None:
        """Return the serial line of a wired tool, None if no port is set; RuntimeError if no tool is wired."""
        wired = [tool for tool in self._tools if tool.link == "serial"]
        if not self.settings.serial_port:
            return None
        if not wired:
            raise RuntimeError("serial_port: must be empty, because no tool file describes a wired tool (code: serial)")
        return SerialBytes(self.settings.serial_port, wired[0].serial.baud, time.monotonic)

    def _buffer(self, link: str) -> MessageBuffer | None:
        """
        Subscribe to the topic of a link and return its buffer.

        Return None if the node reads the serial line itself and publishes its bytes.
        """
        topic, kind = gauge_burst.TOPICS[link]
        if link == "mud_pulse" and self.settings.gauge == 2:
            topic += "_2"
        if link == "serial" and self._line is not None:
            self._octets = self.add_publisher(_TYPES[kind], topic, qos.EVENT)
            return None
        return self.add_buffered_subscription(_TYPES[kind], topic, qos.buffered(qos.EVENT))

    def _begin(self, buffers: Sequence[MessageBuffer | None]) -> None:
        self._reference: Reference | None = None
        self._published_attitude = -np.inf
        self._unreadable = 0
        self._inputs = [
            _Input(LinkFeed(tool, self.settings.ages, self._warn), buffer, gauge_burst.TOPICS[tool.link][1])
            for tool, buffer in zip(self._tools, buffers, strict=True)
        ]
        self._surveys = LinkSurveys(self._tools, self._reference_at, self._errors, self.settings.verdict)

    def on_settings_changed(self, settings: ReceiverSettings) -> None:
        """Use the changed settings for the verdict and the reference field of the next surveys."""
        self._reference = None
        self._surveys.quality = settings.verdict

    def _warn(self, words: str) -> None:
        self.get_logger().warning(printable(f"{words}: the receiver begins anew"))

    def _reference_at(self, stamp_ns: int) -> Reference | None:
        if self._reference is None:
            found = reference_of(self.settings.place, stamp_ns)
            code = self.settings.tool_code
            self._reference = reference_for(code, found) if code and found is not None else found
        return self._reference

    # Subscriptions.

    def _on_rig_state(self, message: msg.RigState) -> None:
        for one in self._inputs:
            link, seconds = one.feed.link, one.feed.seconds(stamp_of(message.header.stamp))
            through_mud = one.feed.tool.medium == "mud"
            deep = message.valid & msg.RigState.BIT_DEPTH and 0.0 <= message.bit_depth <= _DEEPEST_M
            if deep and through_mud:
                link.attitude.travel_s = message.bit_depth / _WAVE_SPEED
            if seconds is not None:
                link.take_flow(seconds, message.flow_rate if message.valid & msg.RigState.FLOW_RATE else None)
            known = bool(message.valid & msg.RigState.RATE_OF_PENETRATION)
            link.attitude.speed = abs(message.rate_of_penetration) if known else None
            link.attitude.in_slips = bool(message.valid & msg.RigState.SLIPS and message.in_slips)
            if message.valid & msg.RigState.ROTARY_SPEED:
                link.attitude.rotating = abs(message.rotary_speed) > _TURNING

    def _on_quill(self, message: JointState) -> None:
        for one in self._inputs:
            seconds = one.feed.seconds(stamp_of(message.header.stamp))
            if seconds is not None and len(message.position) and math.isfinite(message.position[0]):
                one.feed.link.attitude.take_quill(seconds, float(message.position[0]))

    def _on_downlink(self, message: msg.DownlinkState) -> None:
        """Change the tool configuration for decoding after a downlink command, once the tool confirms the command."""
        try:
            for one in self._inputs:
                if one.feed.tool.downlink is not None:
                    _follow(one.feed, message)
        except ValueError as error:
            text = f"the downlink is for another tool configuration: {error}"
            self.get_logger().error(printable(text), throttle_duration_sec=10.0)

    def _on_timer(self) -> None:
        self._take_all()
        self._publish_state()

    def _take_all(self) -> None:
        """
        Process all messages that have arrived: the pump strokes, then the pressure.

        Strokes are published after the pressure of the same time. If the strokes were taken out of their buffer first,
        the pressure taken after them could be newer than the newest strokes.
        """
        self._read_line()
        arrived = [one.buffer.drain() if one.buffer is not None else [] for one in self._inputs]
        for data, _ in self._strokes.drain() if self._strokes is not None else ():
            self._take_strokes(deserialize_message(data, msg.StrokeBurst))
        for one, messages in zip(self._inputs, arrived, strict=True):
            self._take_bursts(one, messages)

    def _take_strokes(self, message: msg.StrokeBurst) -> None:
        strokes = list(zip(map(int, message.pump), map(stamp_of, message.stamp), strict=True))
        for one in self._inputs:
            if one.feed.tool.link == "mud_pulse":
                self._publish(one.feed, one.feed.take_strokes(stamp_of(message.header.stamp), strokes))

    def _take_bursts(self, one: _Input, messages: Sequence[ReceivedMessage]) -> None:
        for message in messages:
            try:
                burst = gauge_burst.decode(message.data, one.kind)
            except ValueError as error:
                self._unreadable += 1
                self.get_logger().warning(printable(f"{one.kind} not used: {error}"), throttle_duration_sec=10.0)
                continue
            one.received_at = time.monotonic()
            self._publish(one.feed, one.feed.push(*burst))

    def _read_line(self) -> None:
        """Read the bytes of the serial port, publish them for the recording, and process them."""
        if self._line is None:
            return
        octets = self._line.read()[1].astype(np.uint8)
        one = next(one for one in self._inputs if one.feed.tool.link == "serial")
        if not len(octets):
            return
        period = BITS_PER_BYTE / one.feed.tool.serial.baud
        now_ns = self.get_clock().now().nanoseconds
        start_ns = now_ns - round(len(octets) * period * wire.NANOSECONDS)
        data = gauge_burst.encode(start_ns, period, octets, self.frame(wire.RIG_FRAME))
        self._octets.publish(data)
        one.received_at = time.monotonic()
        self._publish(one.feed, one.feed.push(*gauge_burst.decode(data, one.kind)))

    # Publishers.

    def _publish(self, feed: LinkFeed, out: LinkOutput) -> None:
        link, rig_frame = feed.link, self.frame(wire.RIG_FRAME)
        for word in out.words:
            message = link_messages.word_message(word, link.tool, link.name, feed.stamp_of)
            message.header.frame_id = rig_frame
            self._word.publish(message)
        travel_s = link.attitude.travel_s
        samples = [*log_samples(out.words, link.tool, lambda at: feed.stamp_of(at - travel_s))]
        samples += (sample for heard in out.surveys for sample in survey_samples(heard, link.tool))
        for sample in samples:
            self._log.publish(dataclasses.replace(sample, frame_id=self.frame(wire.SONDE_FRAME)).to_message(make))
        for frame in out.frames:
            words = [word for word in out.words if word.frame == frame.frame and word.revision]
            report = link_messages.frame_message(frame, words, link.name, feed.stamp_of)
            report.header.frame_id = rig_frame
            self._frame_publisher.publish(report)
        for at, quality in out.states:
            self._publish_quality(quality, link.name, feed.stamp_of(at))
        now_ns = feed.stamp_of(link.now_s) if feed.heard else 0
        for heard in out.surveys:
            self._publish_surveys(self._surveys.take(heard, now_ns))
        self._publish_surveys(self._surveys.advance(now_ns))

    def _publish_quality(self, quality: Quality, link: str, stamp_ns: int) -> None:
        message = link_messages.quality_message(quality, link, stamp_ns)
        message.header.frame_id = self.frame(wire.RIG_FRAME)
        self._quality.publish(message)

    def _publish_surveys(self, surveys: Sequence[Survey]) -> None:
        for survey in surveys:
            self._survey.publish(dataclasses.replace(survey, frame_id=self.frame(wire.SONDE_FRAME)).to_message(make))
            self.get_logger().info(printable(f"survey {survey.sequence} received: {'; '.join(survey.reasons)}"))

    def _publish_state(self) -> None:
        """
        Publish the attitude twice and the quality once per second of sample time.

        While no samples arrive, the seconds come from the monotonic clock.
        """
        for one in self._inputs:
            link = one.feed.link
            now = link.now_s if one.feed.heard and not one.silent else time.monotonic()
            if abs(now - one.published_quality) >= _QUALITY_S:
                one.published_quality = now
                stamp_ns = one.feed.stamp_of(link.now_s) if one.feed.heard else 0
                self._publish_quality(link.quality(silent=one.silent), link.name, stamp_ns)
        speaking = [one.feed for one in self._inputs if one.feed.heard and not one.silent]
        if not speaking:
            return
        now_ns = max(feed.stamp_of(feed.link.now_s) for feed in speaking)
        if abs(now_ns - self._published_attitude) < _ATTITUDE_S * wire.NANOSECONDS:
            return
        self._published_attitude = now_ns
        reference = self._reference_at(now_ns)
        rows = [
            one.feed.link.attitude.sample(one.feed.seconds(now_ns) or 0.0, now_ns, reference)
            for one in self._inputs
            if one.feed.heard
        ]
        row = link_attitude.best(rows)
        self._attitude.publish(wire.ATTITUDE.encode(row, self.frame(wire.SONDE_FRAME))[0].tobytes())

    def deactivate(self) -> None:
        """Process the remaining messages, publish the remaining results, and prepare the links for new data."""
        self._take_all()
        for one in self._inputs:
            self._publish(one.feed, one.feed.finish())
        self._publish_surveys(self._surveys.finish())
        self._begin([one.buffer for one in self._inputs])

    def cleanup(self) -> None:
        """Close the serial line."""
        if self._line is not None:
            self._line.close()

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Return diagnostics of each link, of a serial line that fails, and, with samples, of the reference field."""
        found = [self._diagnostic(one) for one in self._inputs]
        if self._line is not None and self._line.failure:
            found.append(Diagnostic("serial line", ERROR, self._line.failure, "check the cable and the port"))
        heard = [one.feed for one in self._inputs if one.feed.heard]
        # The reference field depends on the date, which is taken from the stamps of the samples.
        if heard:
            found.append(reference_diagnostic(self._reference_at(heard[0].stamp_of(heard[0].link.now_s))))
        return found

    def _diagnostic(self, one: _Input) -> Diagnostic:
        quality = one.feed.link.quality(silent=one.silent)
        values = (
            ("ebn0_db", f"{quality.ebn0_db:.1f}"),
            ("toolface_age_s", f"{quality.toolface_age:.0f}"),
            ("unreadable", str(self._unreadable)),
        )
        name = "link" if len(self._inputs) == 1 else f"link {one.feed.tool.link}"
        lost = ERROR if one.feed.heard else WARN
        level = {NO_INPUT: lost, NO_FLOW: OK, LOCKED: OK}.get(quality.state, WARN)
        return Diagnostic(name, level, quality.reason or "words arrive", values=values)


def _follow(feed: LinkFeed, message: msg.DownlinkState) -> None:
    sequence, pulse_width, carrier, rate, mute = message.in_force
    settings = ToolSettings(sequence, pulse_width, carrier, rate, bool(mute))
    feed.in_force = tool_commands.applied(feed.tool, settings)
    if message.state not in (msg.DownlinkState.RUNNING, msg.DownlinkState.SENT):
        feed.following.go_on_as(feed.in_force)
        return
    frame = DownlinkFrame(message.counter, COMMANDS.index(message.command), message.argument)
    if feed.following.expects != frame.echo:
        feed.following.go_on_as(feed.in_force)
        feed.following.expect(tool_commands.applied(feed.tool, settings.after(frame)), frame.echo)


def main(args: Sequence[str] | None = None) -> int:
    """Run the receiver node; return the exit status of the process."""
    return run_node(ReceiverNode, args)


# Compile the receiver's kernels before the first sample arrives.


# Samples per time unit of the code, or per carrier period: more than in the receiver's grid, as with a real gauge.
_SAMPLES = 100.0
_NOISE = 0.1  # 1 sigma of the added noise, as a share of the amplitude; the noise model needs some noise


def warm_up(tools: Iterable[ToolConfiguration]) -> None:
    """Receive an artificial survey of each tool, to compile every kernel before the first sample arrives."""
    for tool in tools:
        if tool.code != "serial":  # no kernel is needed to read bytes
            _receive_survey(tool)


def _receive_survey(tool: ToolConfiguration) -> None:
    carrier = tool.code == "psk"
    duration = tool.transmit_delay_s + tool.head_s + tool.seconds(tool.surveys[0])
    at = np.arange(0.0, duration, (1.0 / tool.carrier.frequency_hz if carrier else tool.tu_s) / _SAMPLES)
    receiver = receiver_of(tool)
    noise = np.random.default_rng(0).normal(0.0, _NOISE, len(at))
    since = at - tool.transmit_delay_s
    if isinstance(receiver, SampledReceiver):
        receiver.strokes(1, np.arange(0.0, duration, 1.0))
    receiver.push(at, noise + (_carrier(tool, since) if carrier else _pulses(tool, since)))
    receiver.finish()


def _pulses(tool: ToolConfiguration, time_s: Array) -> Array:
    """Return the pulse signal, 0 or 1, of a survey whose words are 0, at times from its start, s; shape (n,)."""
    items = tool.surveys[0]
    edges = np.array(encode(tool, items, (0,) * len(items), 0).edges) * tool.tu_s
    since = time_s - edges[np.maximum(np.searchsorted(edges, time_s, side="right") - 1, 0)]
    return ((since >= 0.0) & (since < PULSE_TU * tool.tu_s)).astype(float)


def _carrier(tool: ToolConfiguration, time_s: Array) -> Array:
    """Return the carrier, -1 to 1, of a survey whose words are 0, at times from its start, s; shape (n,)."""
    phases: list[float] = []
    for group in on_air.groups(tool, "survey", 0):
        phases += on_air.signal(tool, group, tool.sent(group.items, (0,) * len(group.items))).phases
    symbol = np.floor(time_s * tool.carrier.symbol_rate_hz).astype(int)
    phase = np.array(phases)[np.clip(symbol, 0, len(phases) - 1)]
    return np.where(time_s >= 0.0, np.cos(2.0 * np.pi * tool.carrier.frequency_hz * time_s + phase), 0.0)
