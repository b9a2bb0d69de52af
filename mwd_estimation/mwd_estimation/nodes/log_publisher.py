# SPDX-License-Identifier: Apache-2.0
"""Log channels of the estimator node: subscribes to detector and tool status, and publishes `log`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from mwd_msgs.msg import DetectorCounts, ToolStatus
from mwd_msgs.msg import LogSample as LogMessage

from mwd_estimation.downhole.log_sampler import LogSampler
from mwd_estimation.pipeline.output import Output
from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros import qos
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.messages import make
from mwd_sensors.telemetry.log_channels import LogChannel, LogSample

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
            self._sampler.push(stream, wire.decode_messages(layout, [message.data for message in buffer.take()])[0])
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
