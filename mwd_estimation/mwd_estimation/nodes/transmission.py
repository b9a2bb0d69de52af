# SPDX-License-Identifier: Apache-2.0
"""Publishers of the tool: what it transmits while the pumps run (`tool/transmission`), and its log (`log`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from mwd_msgs.msg import DetectorCounts, ToolFlow, ToolStatus
from mwd_msgs.msg import LogSample as LogMessage
from mwd_msgs.msg import Transmission as TransmissionMessage

from mwd_estimation.downhole.log_sampler import LogSampler
from mwd_estimation.downhole.settings import Transmit
from mwd_estimation.downhole.transmitter import Sent, Transmitter
from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.survey.survey import STATIC
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.messages import make
from mwd_sensors.ros.time_stamps import header, stamp
from mwd_sensors.telemetry import log_channels, tool_configuration
from mwd_sensors.telemetry.log_channels import LogChannel, LogSample

# Largest delay of the flow behind the estimates, s; with a larger delay the flow counts as stopped.
_LATE_S = 5.0


class TransmissionPublisher:
    """
    The transmitters of the tool, one for each telemetry link; without a tool file nothing is transmitted.

    Raises
    ------
    ValueError, OSError
        If a tool configuration cannot be read, or two of them name the same link.
    """

    def __init__(self, node: GraphNode[Any], settings: Transmit) -> None:
        self._settings = settings
        self._sent = 0
        self._set_back = 0
        files = [file for file in (settings.tool_file, settings.second_tool_file) if file]
        self._tools = tool_configuration.read_several(Path(file).expanduser() for file in files)
        self._begin_anew()
        if not self._tools:
            return
        self._flow = node.add_buffered_subscription(ToolFlow, "tool/flow", qos.buffered(qos.EVENT))
        self._publisher = node.add_publisher(TransmissionMessage, "tool/transmission", qos.EVENT)

    def _begin_anew(self) -> None:
        self._transmitters = [Transmitter(tool, self._settings) for tool in self._tools]

    @property
    def channels(self) -> Mapping[str, LogChannel]:
        """Log channels of the first tool by name; the default channels without a tool."""
        return self._tools[0].logged if self._tools else log_channels.CHANNELS

    def take(self, imu: Samples, output: Output, pipeline: Pipeline, running: Running, frame: str) -> None:
        """
        Accept a block of samples and its results, and publish what the tool transmitted (sync, header, words).

        The transmitters begin anew if time was set back. imu: samples of the conventional unit in axes of the unit;
        running: running means of the log channels; frame: frame id of the messages.
        """
        if not self._transmitters:
            return
        if pipeline.counters.set_back > self._set_back:
            self._set_back = pipeline.counters.set_back
            self._begin_anew()
        flows, _ = wire.decode_messages(wire.TOOL_FLOW, [message.data for message in self._flow.drain()])
        imu_t = pipeline.mount.imu_in_tool(imu)
        for transmitter in self._transmitters:
            transmitter.take_flow(flows)
            transmitter.take_rotation(imu_t)
            for survey in output.surveys:
                if survey.kind == STATIC:
                    transmitter.take_survey(survey)
            transmitter.take_dynamics(output.dynamics)
            for known_ns, means in running:
                transmitter.take_logs(known_ns, means)
            for sent in transmitter.advance(output.attitude, pipeline.reference):
                self._publisher.publish(transmission_message(sent, frame))
                self._sent += 1

    def diagnostics(self) -> list[Diagnostic]:
        """Return the diagnostics of each transmitter."""
        values = (("sent", str(self._sent)),)
        found = []
        for transmitter in self._transmitters:
            name = f"transmission {transmitter.tool.link}"
            if transmitter.wired or (transmitter.knows_flow and transmitter.waits_s <= _LATE_S):
                found.append(Diagnostic(name, OK, str(transmitter.state), values=values))
                continue
            stopped = transmitter.knows_flow
            text = f"silent: the flow {'is no longer received' if stopped else 'is not known'}"
            remedy = f"the tool transmits by flow: {'has tool/flow stopped?' if stopped else 'is tool/flow published?'}"
            found.append(Diagnostic(name, WARN, text, remedy, values))
        return found


def transmission_message(sent: Sent, frame: str) -> TransmissionMessage:
    """Return a transmitted sync, header or word as mwd_msgs/Transmission; frame: frame id of the message."""
    tool = sent.tool
    message = TransmissionMessage(
        header=header(sent.start_ns, frame),
        kind=int(sent.kind),
        frame=sent.frame,
        sequence=sent.sequence,
        name=sent.name,
        raw=sent.raw,
        bits=sent.bits,
        value=math.nan if sent.reading is None else sent.reading.value,
        sigma=math.nan if sent.reading is None else sent.reading.sigma,
        duration=sent.duration_s,
        link=tool.link,
        code=tool.code,
        pulse_width=tool.pulse_width_s if tool.code == "mary" else math.nan,
        edges=list(sent.edges_s),
        carrier=tool.carrier.frequency_hz if tool.code == "psk" else math.nan,
        symbol_period=tool.symbol_s,
        phases=list(sent.phases),
        octets=list(sent.octets),
    )
    if sent.reading is not None:
        message.measured = stamp(sent.reading.stamp_ns)
    return message


Running = list[tuple[int, dict[str, LogSample]]]


class LogPublisher:
    """Publisher of the log channels, which a sampler computes from inputs and results of the estimator."""

    def __init__(self, node: GraphNode[Any], channels: Mapping[str, LogChannel]) -> None:
        self._sampler = LogSampler(channels)
        self._frame = ""
        self._counts = node.add_buffered_subscription(DetectorCounts, wire.GAMMA_TOPIC, qos.buffered(qos.STREAM))
        self._status = node.add_buffered_subscription(ToolStatus, wire.STATUS_TOPIC, qos.buffered(qos.STREAM))
        self._publisher = node.add_publisher(LogMessage, "log", qos.EVENT)

    def push_temperature(self, samples: Samples) -> None:
        """Add samples of `wire.TEMPERATURE` that the input gate has accepted."""
        self._sampler.push("temperature", samples)

    def take(self, output: Output, frame: str) -> Running:
        """Publish the log samples that a block of results completes; return the running means for telemetry words."""
        self._frame = frame
        for stream, layout, buffer in (
            ("counts", wire.COUNTS, self._counts),
            ("status", wire.TOOL_STATUS, self._status),
        ):
            self._sampler.push(stream, wire.decode_messages(layout, [message.data for message in buffer.drain()])[0])
        self._sampler.push("dynamics", output.dynamics)
        self._publish(self._sampler.advance(output.attitude))
        running, self._sampler.running = self._sampler.running, []
        return running

    def finish(self) -> None:
        """Publish the last, incomplete interval of each channel."""
        self._publish(self._sampler.finish())

    def _publish(self, samples: Iterable[LogSample]) -> None:
        for sample in samples:
            message = sample.to_message(make)
            message.header.frame_id = self._frame
            self._publisher.publish(message)
