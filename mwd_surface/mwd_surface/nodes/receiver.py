"""The receiver as a node: standpipe pressure in; words, surveys, attitude and state of the link out."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mwd_msgs import msg
from sensor_msgs.msg import JointState

from mwd_estimation.core.reference_field import Reference
from mwd_estimation.pipeline import reference_of
from mwd_estimation.survey.tool_code import reference_for, sensor_errors
from mwd_sensors.core import gauge_burst, wire
from mwd_sensors.core.arrays import Array
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.run_node import run_node
from mwd_sensors.telemetry import tool_commands, tool_configuration
from mwd_sensors.telemetry.downlink import COMMANDS, Frame
from mwd_sensors.telemetry.tool_commands import ToolSettings
from mwd_surface.nodes.receiver_settings import ReceiverSettings
from mwd_surface.receiver.following_link import FollowingLink
from mwd_surface.receiver.link import LOCKED, NO_FLOW, NO_INPUT, Link, LinkOutput
from mwd_surface.ros import link_messages

_PERIOD_S = 0.05
_SILENT_S = 5.0
_LONGEST_GAP_S = 3600.0  # a longer one begins anew: no sync outlives it, and filling it would take seconds
_QUALITY_S, _ATTITUDE_S = 1.0, 0.5
_WAVE_SPEED = 1250.0  # m/s of pressure waves in mud (Korteweg), for the age of a word
_LEAST_FLOW = 0.005  # m^3/s of the pumps; less does not turn a tool's generator
_DEEPEST_M = 20_000.0  # no hole is deeper
_TURNING = 0.5  # rad/s of the top drive; slower is sliding


# By what carries the words: name of the link, topic of its samples, and its type.
_LINKS: dict[str, tuple[str, str, Any]] = {
    "mud": ("mud_pulse", "rig/standpipe", msg.PressureBurst),
    "earth": ("em", "rig/earth_voltage", msg.VoltageBurst),
}


class ReceiverNode(GraphNode[ReceiverSettings]):
    """Subscribes to what the rig measures, to nothing of the tool."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("receiver", ReceiverSettings(), **node_options)
        self._following: FollowingLink | None = None

    @property
    def _link(self) -> Link | None:
        return None if self._following is None else self._following.link

    def configure(self) -> None:
        """Read the tool configuration and open the topics."""
        settings = self.settings
        if not settings.tool_file:
            raise RuntimeError("tool_file: a receiver needs the tool configuration; `mwd tool new` writes one")
        try:
            self._tool = tool_configuration.read(Path(settings.tool_file).expanduser())
            self._errors = sensor_errors(settings.tool_code) if settings.tool_code else None
        except (ValueError, OSError) as error:
            raise RuntimeError(str(error)) from error
        if self._tool.medium not in _LINKS:
            raise RuntimeError("tool_file: this node reads pressure or voltage; read a serial line by `mwd decode`")
        self._in_force = self._tool
        self._new_link()
        _, topic, kind = _LINKS[self._tool.medium]
        topic += "_2" if settings.gauge == 2 else ""
        self._pressure = self.add_buffered_subscription(kind, topic, qos.buffered(qos.EVENT))
        self.add_subscription(msg.RigState, "rig/state", self._on_rig_state, qos.EVENT)
        self.add_subscription(JointState, "rig/quill", self._on_quill, qos.STATE)
        if self._tool.downlink is not None:
            self.add_subscription(msg.DownlinkState, "downlink/state", self._on_downlink, qos.EVENT)
        self._word = self.add_publisher(msg.LinkWord, "link/word", qos.EVENT)
        self._frame_publisher = self.add_publisher(msg.LinkFrame, "link/frame", qos.EVENT)
        self._quality = self.add_publisher(msg.LinkQuality, "link/quality", qos.STATE)
        self._attitude = self.add_publisher(msg.Attitude, "link/attitude", qos.STATE)
        self._survey = self.add_publisher(msg.Survey, "link/survey", qos.EVENT)
        self.add_timer(_PERIOD_S, self._on_timer)

    def _new_link(self) -> None:
        self._origin_ns: int | None = None
        self._received_at = self._published_quality = self._published_attitude = -np.inf
        self._unreadable = 0
        self._reference: Reference | None = None
        self._following = FollowingLink(
            Link(
                self._in_force,
                _LINKS[self._tool.medium][0],
                self.settings.ages,
                self._reference_at,
                self._stamp_of,
                self._errors,
            )
        )

    def _reference_at(self, stamp_ns: int) -> Reference | None:
        if self._reference is None:
            found = reference_of(self.settings.place, stamp_ns)
            code = self.settings.tool_code
            self._reference = reference_for(code, found) if code and found is not None else found
        return self._reference

    def _stamp_of(self, seconds: float) -> int:
        return (self._origin_ns or 0) + round(seconds * wire.NANOSECONDS)

    # Subscriptions.

    def _on_rig_state(self, message: msg.RigState) -> None:
        link = self._link
        if link is None:
            return
        if message.valid & msg.RigState.BIT_DEPTH and 0.0 <= message.bit_depth <= _DEEPEST_M:
            link.attitude.travel_s = message.bit_depth / _WAVE_SPEED
        if message.valid & msg.RigState.FLOW_RATE and self._tool.medium == "earth" and self._origin_ns is not None:
            stamp_ns = message.header.stamp.sec * wire.NANOSECONDS + message.header.stamp.nanosec
            link.flow.switch((stamp_ns - self._origin_ns) / wire.NANOSECONDS, message.flow_rate > _LEAST_FLOW)
        if message.valid & msg.RigState.ROTARY_SPEED:
            link.attitude.rotating = abs(message.rotary_speed) > _TURNING

    def _on_quill(self, message: JointState) -> None:
        if self._link is None or self._origin_ns is None or not len(message.position):
            return
        if not math.isfinite(message.position[0]):
            return
        at = message.header.stamp.sec * wire.NANOSECONDS + message.header.stamp.nanosec
        self._link.attitude.take_quill((at - self._origin_ns) / wire.NANOSECONDS, float(message.position[0]))

    def _on_downlink(self, message: msg.DownlinkState) -> None:
        """Follow the tool to the configuration to which a command leads, once it says that it has obeyed."""
        following = self._following
        if following is None:
            return
        sequence, pulse_width, carrier, rate, mute = message.in_force
        settings = ToolSettings(sequence, pulse_width, carrier, rate, bool(mute))
        try:
            self._in_force = tool_commands.applied(self._tool, settings)
            if message.state in (msg.DownlinkState.RUNNING, msg.DownlinkState.SENT):
                frame = Frame(message.counter, COMMANDS.index(message.command), message.argument)
                if following.expects != frame.echo:
                    following.go_on_as(self._in_force)
                    following.expect(tool_commands.applied(self._tool, settings.after(frame)), frame.echo)
            else:
                following.go_on_as(self._in_force)
        except ValueError as error:
            text = f"the downlink is for another tool configuration: {error}"
            self.get_logger().error(text, throttle_duration_sec=10.0)

    def _on_timer(self) -> None:
        for data, _ in self._pressure.take():
            try:
                self._take(*gauge_burst.decode(data))
            except ValueError as error:
                self._unreadable += 1
                self.get_logger().warning(f"pressure not used: {error}", throttle_duration_sec=10.0)
        self._publish_state()

    def _take(self, start_ns: int, period: float, pressure: Any) -> None:
        self._received_at = time.monotonic()
        if self._origin_ns is None:
            self._origin_ns = start_ns
        link = self._link
        if link is None or self._following is None:
            return
        seconds: Array = (start_ns - self._origin_ns) / wire.NANOSECONDS + period * np.arange(
            len(pressure), dtype=np.float64
        )
        back = len(seconds) and seconds[-1] < link.now_s - _SILENT_S
        if back or (len(seconds) and np.isfinite(link.now_s) and seconds[0] > link.now_s + _LONGEST_GAP_S):
            words = "went back by more than 5 s" if back else "went on by more than an hour"
            self.get_logger().warning(f"the pressure's time {words}: the receiver begins anew")
            self._new_link()
            self._take(start_ns, period, pressure)
            return
        self._publish(self._following.push(seconds, pressure))

    # Publishers.

    def _publish(self, out: LinkOutput) -> None:
        link = self._link
        if link is None:
            return
        rig_frame = self.frame(wire.RIG_FRAME)
        for word in out.words:
            message = link_messages.word_message(word, link.tool, link.name, self._stamp_of)
            message.header.frame_id = rig_frame
            self._word.publish(message)
        for frame in out.frames:
            words = [word for word in out.words if word.frame == frame.frame and word.revision]
            report = link_messages.frame_message(frame, words, link.name, self._stamp_of)
            report.header.frame_id = rig_frame
            self._frame_publisher.publish(report)
        for survey in out.surveys:
            self._survey.publish(link_messages.survey_message(survey, self.frame(wire.SONDE_FRAME)))
            self.get_logger().info(f"survey {survey.sequence} received: {'; '.join(survey.reasons)}")

    def _publish_state(self) -> None:
        """Attitude twice a second and quality once a second of the pressure's time; of wall time where it stands."""
        link = self._link
        if link is None:
            return
        silent = time.monotonic() - self._received_at > _SILENT_S
        now = link.now_s if not silent and np.isfinite(link.now_s) else time.monotonic()
        if abs(now - self._published_quality) >= _QUALITY_S:
            self._published_quality = now
            stamp_ns = self._stamp_of(link.now_s) if np.isfinite(link.now_s) else 0
            message = link_messages.quality_message(link.quality(silent=silent), link.name, stamp_ns)
            message.header.frame_id = self.frame(wire.RIG_FRAME)
            self._quality.publish(message)
        if not silent and self._origin_ns is not None and now - self._published_attitude >= _ATTITUDE_S:
            self._published_attitude = now
            stamp_ns = self._stamp_of(link.now_s)
            row = link.attitude.sample(link.now_s, stamp_ns, self._reference_at(stamp_ns))
            self._attitude.publish(wire.ATTITUDE.encode(row, self.frame(wire.SONDE_FRAME))[0].tobytes())

    def deactivate(self) -> None:
        """Publish what is left."""
        if self._following is not None:
            self._publish(self._following.finish())
        self._new_link()

    def diagnostics(self) -> Sequence[Diagnostic]:
        """State of the link."""
        link = self._link
        if link is None:
            return ()
        silent = time.monotonic() - self._received_at > _SILENT_S
        quality = link.quality(silent=silent)
        values = (
            ("ebn0_db", f"{quality.ebn0_db:.1f}"),
            ("toolface_age_s", f"{quality.toolface_age:.0f}"),
            ("unreadable", str(self._unreadable)),
        )
        lost = ERROR if np.isfinite(link.now_s) else WARN
        level = {NO_INPUT: lost, NO_FLOW: OK, LOCKED: OK}.get(quality.state, WARN)
        return (Diagnostic("link", level, quality.reason or "words arrive", values=values),)


def main(args: Sequence[str] | None = None) -> int:
    """Run the receiver node."""
    return run_node(ReceiverNode, args)
