"""The tool's transmission in the graph: flow in, `tool/transmission` out, at the pace of the estimates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mwd_msgs.msg import ToolFlow
from mwd_msgs.msg import Transmission as TransmissionMessage

from mwd_estimation.downhole.settings import Transmit
from mwd_estimation.downhole.transmitter import Sent, Transmitter
from mwd_estimation.nodes.messages import stamp
from mwd_estimation.output import Output
from mwd_estimation.pipeline import Pipeline
from mwd_sensors.core import wire
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.message_buffer import decode_messages
from mwd_sensors.telemetry import tool_configuration

# Flow so far behind the estimates has stopped, s.
_LATE_S = 5.0


class TransmissionPublisher:
    """
    Runs the tool's transmitter beside the estimator.

    Parameters
    ----------
    node : GraphNode
    settings : Transmit
        Without a tool file nothing is opened and nothing sent.

    Raises
    ------
    ValueError, OSError
        The tool configuration cannot be read.
    """

    def __init__(self, node: GraphNode[Any], settings: Transmit) -> None:
        self._settings = settings
        self._sent = 0
        self._set_back = 0
        self._transmitter: Transmitter | None = None
        if not settings.tool_file:
            return
        self._tool = tool_configuration.read(Path(settings.tool_file).expanduser())
        self._transmitter = Transmitter(self._tool, settings)
        self._flow = node.add_buffered_subscription(ToolFlow, "tool/flow", qos.buffered(qos.EVENT))
        self._publisher = node.add_publisher(TransmissionMessage, "tool/transmission", qos.EVENT)

    def take(self, output: Output, pipeline: Pipeline, frame: str) -> None:
        """Take what the estimator gave for a block, and publish what went on air."""
        if self._transmitter is None:
            return
        if pipeline.counters.set_back > self._set_back:
            self._set_back = pipeline.counters.set_back
            self._transmitter = Transmitter(self._tool, self._settings)
        flows, _ = decode_messages(wire.TOOL_FLOW, [message.data for message in self._flow.take()])
        self._transmitter.take_flow(flows)
        for survey in output.surveys:
            self._transmitter.take_survey(survey)
        self._transmitter.take_dynamics(output.dynamics)
        for sent in self._transmitter.advance(output.attitude, pipeline.reference):
            self._publisher.publish(transmission_message(sent, self._transmitter, frame))
            self._sent += 1

    def diagnostics(self) -> list[Diagnostic]:
        """What the tool transmits."""
        if self._transmitter is None:
            return []
        values = (("sent", str(self._sent)),)
        if not self._transmitter.knows_flow:
            remedy = "the tool transmits by flow: is tool/flow published?"
            return [Diagnostic("transmission", WARN, "silent: the flow is not known", remedy, values)]
        if self._transmitter.waits_s > _LATE_S:
            remedy = "the tool transmits by flow: has tool/flow stopped?"
            return [Diagnostic("transmission", WARN, "silent: the flow does not come any more", remedy, values)]
        return [Diagnostic("transmission", OK, str(self._transmitter.state), values=values)]


def transmission_message(sent: Sent, transmitter: Transmitter, frame: str) -> TransmissionMessage:
    """What went on air, as mwd_msgs/Transmission."""
    message = TransmissionMessage(
        kind=int(sent.kind),
        frame=sent.frame,
        sequence=sent.sequence,
        name=sent.name,
        raw=sent.raw,
        bits=sent.bits,
        value=0.0 if sent.reading is None else sent.reading.value,
        sigma=-1.0 if sent.reading is None else sent.reading.sigma,
        duration=sent.duration_s,
        code=transmitter.tool.code,
        pulse_width=transmitter.tool.pulse_width_s,
        edges=list(sent.edges_s),
    )
    message.header.stamp = stamp(sent.start_ns)
    message.header.frame_id = frame
    if sent.reading is not None:
        message.measured = stamp(sent.reading.stamp_ns)
    return message
