# SPDX-License-Identifier: Apache-2.0
"""Control of the rig over ROS: services, commands of controllers, answers of the rig, and the state."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

from mwd_msgs import msg, srv
from rclpy.serialization import deserialize_message

from mwd_sensors.core import wire
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.messages import make
from mwd_sensors.ros.time_stamps import header
from mwd_surface.control.authority import ControlAuthority
from mwd_surface.control.lease_numbers import LeaseNumbers
from mwd_surface.control.set_point import LeaseLimits, SetPoint
from mwd_surface.control.settings import ControlSettings
from mwd_surface.control.status import Achieved, ControlRequest, ControlState, ControlStatus, Permission, Sender
from mwd_surface.live.alarms import Severity
from mwd_surface.live.latest_values import Freshness, LiveValue
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.ros.seal import SealChecker, SealError
from mwd_surface.ros.topics import TOPICS

_RESTART = "then restart the surface"
_PERIOD = 0.1  # time between two commands to the rig, s
_STATE_PERIOD = 0.5  # time between two messages of an unchanged state, s
_INTERFACE = "ROS"
# Fields of the status that change at every update: a change of these fields alone does not publish a new state.
_ALWAYS_CHANGING = ("heartbeat_age", "remaining", "achieved")


class ControlServer:
    """ROS interface of the control authority of one well."""

    def __init__(self, context: SurfaceContext, settings: ControlSettings) -> None:
        self._context, self._node, self._live = context, context.node, context.live
        self._numbers = LeaseNumbers(context.folder / "control.json")
        first, self._unsafe = 1, ""
        if settings.enabled:
            try:
                # The first lease number is at least the time in seconds since the epoch. If the folder with the numbers
                # was deleted, the new numbers are then above all earlier numbers, because leases are granted less often
                # than once a second.
                first = self._numbers.first(int(time.time()))
            except ValueError as error:
                # Continue without control: page, recording and survey list do not need it.
                self._unsafe = f"nobody can have control: {error}"
                settings = dataclasses.replace(settings, enabled=False)
        #: Authority for rig interfaces and other parts of the node; usable from any thread.
        self.authority = ControlAuthority(settings, first, self._unsafe)
        #: Function that is called with each serialised message, by topic.
        self.handlers = {"control/command": self._on_command, "rig/acknowledge": self._on_acknowledge}
        self._seals = SealChecker()
        self._updated_at = self._published_at = 0.0
        self._shown: dict[str, Any] = {}
        self._reason = ""

    def open(self) -> None:
        """Create the publishers of the state of control and of commands to the rig, and the services for control."""
        node = self._node
        self._names = {name: node.resolve_topic_name(name) for name in ("control/command",)}
        self._names |= {name: node.resolve_service_name(name) for name in ("request_control", "release_control")}
        self._state = node.add_publisher(msg.ControlState, "control/state", TOPICS["control/state"][1])
        self._commands = node.add_publisher(msg.RigCommand, "rig/command", TOPICS["rig/command"][1])
        node.add_service(srv.RequestControl, "request_control", self._request)
        node.add_service(srv.ReleaseControl, "release_control", self._release)
        node.add_service(srv.JudgeControl, "judge_control", self.judge)
        if self._unsafe:
            self._context.alarm_log.raise_alarm("control.numbers", Severity.CRITICAL, self._unsafe, _RESTART)
        self._reserve()

    # Services.

    def _sender(self, name: str, sealed: Any) -> Sender:
        """Return the sender of a sealed message; raise SealError if the sender cannot be identified."""
        return Sender(_INTERFACE, self._seals.key_of(self._names[name], sealed))

    def _request(self, request: Any, response: Any) -> Any:
        try:
            sender = self._sender("request_control", request)
        except SealError as error:
            response.permission, response.message = int(Permission.DENIED), str(error)
            return response
        limits = LeaseLimits(
            **{field.name: getattr(request, f"{field.name}_limit") for field in dataclasses.fields(LeaseLimits)}
        )
        wish = ControlRequest(
            sender, request.controller, request.role, request.priority, request.wait, request.duration, limits
        )
        decision = self.authority.request(wish, time.monotonic())
        response.permission, response.lease = int(decision.permission), decision.lease
        response.success = decision.permission == srv.RequestControl.Response.GRANTED
        response.message = decision.message
        return response

    def _release(self, request: Any, response: Any) -> Any:
        try:
            sender = self._sender("release_control", request)
        except SealError as error:
            response.message = str(error)
            return response
        response.success, response.message = self.authority.release(
            request.lease, time.monotonic(), sender, request.reason
        )
        return response

    def judge(self, request: Any, response: Any) -> Any:
        """Carry out the decision of a person about control of the rig; return the response (service)."""
        response.success, response.message = self.authority.judge(
            request.decision, request.operator_name, time.monotonic(), request.reason, request.number
        )
        return response

    # Messages.

    def _on_command(self, data: bytes) -> None:
        sealed = deserialize_message(data, msg.SealedCommand)
        point = SetPoint.from_message(sealed.command)
        try:
            taken, why = self.authority.command(point, time.monotonic(), self._sender("control/command", sealed))
        except SealError as error:
            self.authority.refused += 1
            taken, why = False, str(error)
        if not taken:
            text = f"a message on control/command was refused: {why}"
            self._node.get_logger().warning(printable(text), throttle_duration_sec=5.0)

    def _on_acknowledge(self, data: bytes) -> None:
        answer = deserialize_message(data, msg.RigAcknowledge)
        self.authority.on_acknowledge(answer.lease, answer.sequence, answer.obeyed, answer.message)

    # Periodic update.

    def update(self, now: float) -> None:
        """
        Update the authority with the state of rig and MWD, send due commands to the rig, and publish the state.

        A call less than `_PERIOD` after the last update does nothing.

        now: monotonic time, s.
        """
        if now - self._updated_at < _PERIOD:
            return
        self._updated_at = now
        well_now = self._context.well_now
        rig, authority = self._live.rig(well_now), self.authority
        achieved = Achieved(_if_live(rig.rotary_speed), _if_live(rig.torque), _if_live(rig.flow_rate))
        authority.on_rig(achieved, now)
        authority.on_mwd(self._live.streams(well_now)["estimator"].state == Freshness.LIVE)
        for point in authority.update(now):
            self._commands.publish(self._command_message(point))
        for text in authority.drain_events():
            self._context.alarm_log.log_event("control", text)
        self._show(authority.status(now), now)

    def _reserve(self) -> None:
        if not self.authority.settings.enabled:
            return
        try:
            self._numbers.reserve(self.authority.upcoming)
        except OSError as error:
            text = f"numbers of leases are not saved: {error}"
            self._context.alarm_log.raise_alarm("control.unsaved", Severity.WARNING, text, "free space on the disk")
        else:
            self._context.alarm_log.clear_alarm("control.unsaved")

    def _show(self, status: ControlStatus, now: float) -> None:
        fields = {name: value for name, value in vars(status).items() if name not in _ALWAYS_CHANGING}
        if fields == self._shown and now - self._published_at < _STATE_PERIOD:
            return
        self._shown, self._published_at = fields, now
        self._reserve()
        self._live.show(self._context.well_now, control=status)
        message = status.to_message(make)
        message.header = header(self._context.now_ns(), self._node.frame(wire.RIG_FRAME))
        self._state.publish(message)
        if status.state == ControlState.FAULT:
            if status.reason != self._reason:
                remedy = "take control back on the page, or let a controller take a new lease"
                self._context.alarm_log.raise_alarm("control.fault", Severity.CRITICAL, status.reason, remedy)
            self._reason = status.reason
        elif self._reason:
            self._reason = ""
            self._context.alarm_log.clear_alarm("control.fault")

    def _command_message(self, point: SetPoint) -> Any:
        message = dataclasses.replace(point, stamp_ns=point.stamp_ns or self._context.now_ns()).to_message(make)
        message.header.frame_id = self._node.frame(wire.RIG_FRAME)
        return message

    def diagnostics(self) -> list[Diagnostic]:
        """
        Return a diagnostic with the owner of control and the number of refused commands.

        The list is empty if control is off. If the lease numbers cannot be used, the diagnostic has the reason.
        """
        if self._unsafe:
            return [Diagnostic("control", WARN, self._unsafe, _RESTART)]
        if not self.authority.settings.enabled:
            return []
        status = self.authority.status(time.monotonic())
        values = (("refused", str(self.authority.refused)), ("sequence", str(status.sequence)))
        name = status.owner
        words = f"{name} has control" if name else "the driller has control"
        if status.state == ControlState.FAULT:
            return [Diagnostic("control", WARN, status.reason, "take control back, or grant a new lease", values)]
        if status.refusal:
            return [Diagnostic("control", WARN, f"{words}; {status.refusal}", "correct the set-point", values)]
        return [Diagnostic("control", OK, words, values=values)]


def _if_live(value: LiveValue) -> float | None:
    return value.value if value.state == Freshness.LIVE else None
