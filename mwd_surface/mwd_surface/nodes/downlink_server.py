# SPDX-License-Identifier: Apache-2.0
"""Downlink over ROS: services and action, control of the rig while a command is sent, journal and page."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mwd_msgs import msg, srv
from mwd_msgs.action import Downlink
from rclpy.serialization import deserialize_message

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples
from mwd_sensors.ros.deferred import DeferredGoal
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.messages import make
from mwd_sensors.ros.time_stamps import header
from mwd_sensors.telemetry import tool_configuration
from mwd_sensors.telemetry.downlink import ECHO_WORD, ROTATION
from mwd_surface.control.authority import ControlAuthority
from mwd_surface.downlink.machine import ENDED, NEXT, DownlinkState, InterlockReadings, Machine, Transition
from mwd_surface.downlink.memory import Kept, Memory
from mwd_surface.downlink.rig_control import RigClock, RigControl
from mwd_surface.downlink.settings import DownlinkSettings
from mwd_surface.downlink.status import DownlinkStatus
from mwd_surface.live.alarms import Severity
from mwd_surface.ros.context import SurfaceContext
from mwd_surface.ros.topics import TOPICS

_STATE_PERIOD = 1.0  # time between two messages of an unchanged state, s
# States whose details change without a transition: failed interlocks, symbol, set-point.
_SHOWN = {DownlinkState.GRANTED, DownlinkState.ARMED, DownlinkState.RUNNING}
_NO_TOOL = "this surface sends no commands: set downlink.tool_file to a tool.yaml with a downlink"
_RESTART = "then restart the surface"
# States that are reported as warnings.
_LOUD = {DownlinkState.ABORTED, DownlinkState.UNCONFIRMED}


class DownlinkServer:
    """
    ROS interface for the downlink commands of one well.

    Parameters
    ----------
    settings : DownlinkSettings
        Settings of the downlink; without a tool file, no topic or service is opened.

    Raises
    ------
    ValueError, OSError
        The tool configuration cannot be read, or the tool accepts no commands.
    """

    def __init__(self, context: SurfaceContext, settings: DownlinkSettings, authority: ControlAuthority) -> None:
        self._context, self._node, self._live = context, context.node, context.live
        self._rig = RigControl(authority)
        self._memory = Memory(context.folder / "downlink.json")
        self._machine: Machine | None = None
        self._refusal = _NO_TOOL
        if settings.tool_file:
            (tool,) = tool_configuration.read_several([Path(settings.tool_file).expanduser()])
            try:
                kept = self._memory.read(tool)
            except ValueError as error:
                # Continue without downlink: page, recording and survey list do not need it.
                self._refusal = f"no command can be sent to the tool: {error}"
                context.alarm_log.raise_alarm("downlink.memory", Severity.WARNING, self._refusal, _RESTART)
            else:
                self._machine = kept.machine(tool, settings)
        self._goal: DeferredGoal | None = None
        self._published_at = -math.inf
        self._clock = RigClock()
        self._link_seen: tuple[float, bool] = (-math.inf, False)

    def open(self) -> None:
        """
        Create the publisher of the state, the services and the action.

        Without a tool file nothing is created; if no command can be sent, only the services.
        """
        node = self._node
        if self._machine is None and self._refusal == _NO_TOOL:
            return
        node.add_service(srv.DraftDownlink, "draft_downlink", self.draft)
        node.add_service(srv.DecideDownlink, "decide_downlink", self.decide)
        if self._machine is None:
            # Open only the services, which answer each request with the reason why no command can be sent.
            return
        self._state = node.add_publisher(msg.DownlinkState, "downlink/state", TOPICS["downlink/state"][1])
        node.add_action_server(Downlink, "downlink", self._start_goal, self._cancel_goal)

    def activate(self) -> None:
        """Publish the state, so that subscribers get a state before the first command."""
        if self._machine is not None:
            self._publish(self._machine, self._now())

    @property
    def handlers(self) -> dict[str, Callable[[bytes], None]]:
        """Handlers by topic, called with each serialised message; empty if no command can be sent."""
        return {} if self._machine is None else {"link/word": self._on_word, "link/quality": self._on_quality}

    def stop(self) -> None:
        """End a running command: the rig returns to the settings of the driller."""
        if self._machine is not None and DownlinkState.ABORTED in NEXT[self._machine.state]:
            self._machine.abort("the surface stops", "", self._now())
            self._follow(self._machine, self._now())

    # Services and action.

    def draft(self, request: Any, response: Any) -> Any:
        """Compose a command; return the response, with the reason if the command is refused (service)."""
        return self._answer(
            response, lambda machine, now: machine.draft(request.command, request.value, request.operator_name, now)
        )

    def decide(self, request: Any, response: Any) -> Any:
        """Submit, grant, deny or abort a downlink; return the response, with the reason if refused (service)."""
        name, kind = request.operator_name, srv.DecideDownlink.Request

        def carry_out(machine: Machine, now: float) -> str:
            if request.decision == kind.SUBMIT:
                return machine.submit(name, now, request.number)
            if request.decision == kind.ABORT:
                return machine.abort(f"aborted by {name}" if name.strip() else "aborted", name, now)
            if request.decision not in (kind.GRANT, kind.DENY):
                raise ValueError("decision: must be 0 (submit), 1 (grant), 2 (deny) or 3 (abort)")
            return machine.decide(request.decision == kind.GRANT, name, now, request.number)

        return self._answer(response, carry_out)

    def _answer(self, response: Any, call: Any) -> Any:
        machine, now = self._machine, self._now()
        if machine is None:
            response.success, response.message = False, self._refusal
            return response
        try:
            response.message, response.success = call(machine, now), True
        except ValueError as error:
            response.message, response.success = str(error), False
        # Carry out the change at once, because an abort must not wait for the next period.
        self._follow(machine, now)
        return response

    def _start_goal(self, goal: DeferredGoal) -> None:
        machine, now, request = self._machine, self._now(), goal.request
        if machine is None:
            return
        try:
            machine.draft(request.command, request.value, request.requested_by, now)
            machine.submit(request.requested_by, now)
        except ValueError as error:
            goal.finish(Downlink.Result(success=False, message=str(error), state=int(machine.state)))
        else:
            self._goal = goal
        self._follow(machine, now)

    def _cancel_goal(self, goal: DeferredGoal) -> None:
        machine, now = self._machine, self._now()
        if machine is not None and goal is self._goal and DownlinkState.ABORTED in NEXT[machine.state]:
            machine.abort("cancelled by its client", "", now)
            self._follow(machine, now)

    # Messages.

    def _on_word(self, data: bytes) -> None:
        """Pass a serialised word of the link to the machine if the word is an accepted echo (an answer of the tool)."""
        word = deserialize_message(data, msg.LinkWord)
        if word.name.lower() == ECHO_WORD.lower() and word.status == msg.LinkWord.BELIEVED and self._machine:
            self._machine.on_echo(int(word.raw), self._now())
            self._follow(self._machine, self._now())
            self._remember(self._machine)

    def _on_quality(self, data: bytes) -> None:
        """Store whether the link is locked, from a serialised message."""
        state = deserialize_message(data, msg.LinkQuality).state
        self._link_seen = (time.monotonic(), state == msg.LinkQuality.LOCKED)

    def on_rig_state(self, samples: Samples) -> None:
        """
        Update the machine with the state of the rig.

        samples: of the layout `wire.RIG_STATE`. The downlink programme runs on the clock of their stamps.
        """
        machine = self._machine
        if machine is None:
            return
        for row in samples:
            now = self._clock.take(int(row["stamp_ns"]) * 1e-9, time.monotonic())
            machine.update(now, self._readings(row), time.monotonic())
            self._follow(machine, now)

    # Clock and periodic update.

    def _now(self) -> float:
        return self._clock.now(time.monotonic(), self._context.now_ns() * 1e-9)

    def update(self, now: float) -> None:
        """Update the machine if the rig has stopped sending data; now: monotonic time, s."""
        machine = self._machine
        if machine is not None and self._clock.silent(now):
            machine.update(self._now(), InterlockReadings(), now)
            self._follow(machine, self._now())

    def _readings(self, row: Samples) -> InterlockReadings:
        valid, kind = int(row["valid"]), msg.RigState
        known = {
            name: float(row[field]) if valid & bit else None
            for name, field, bit in (
                ("flow", "flow_rate", kind.FLOW_RATE),
                ("rotary_speed", "rotary_speed", kind.ROTARY_SPEED),
                ("pressure", "pressure", kind.PRESSURE),
            )
        }
        at, locked = self._link_seen
        return InterlockReadings(
            rig_age_s=0.0,
            in_slips=bool(row["in_slips"]) if valid & kind.SLIPS else None,
            link_locked=locked,
            link_age_s=time.monotonic() - at,
            survey_running=self._live.parts.survey_progress.active,
            no_control=self._rig.why_not(time.monotonic()),
            **known,
        )

    def _follow(self, machine: Machine, now: float) -> None:
        """
        Carry out the changes of a machine: command the rig, write journal and memory, publish state and result.

        The command is aborted if the rig cannot be controlled.
        """
        # The authority uses the monotonic clock, because heartbeats come from computers, not from the rig.
        steady = time.monotonic()
        if machine.set_point is not None:
            why = "" if self._rig.has else self._rig.take(machine.decided_by, steady)
            why = why or self._rig.ask(machine.downlink.medium == ROTATION, machine.set_point, steady)
            if why:
                machine.abort(why, "", now)
        if machine.set_point is None:
            self._rig.release(steady, machine.reason)
        changes, machine.transitions = machine.transitions, []
        for change in changes:
            self._log(change)
        if changes:
            self._remember(machine)
        if changes or (machine.state in _SHOWN and now - self._published_at >= _STATE_PERIOD):
            self._publish(machine, now)

    def _remember(self, machine: Machine) -> None:
        try:
            self._memory.write(Kept.of(machine))
        except OSError as error:
            text = f"the tool's settings are not saved: {error}"
            self._context.alarm_log.raise_alarm("downlink.unsaved", Severity.WARNING, text, "free space on the disk")
        else:
            self._context.alarm_log.clear_alarm("downlink.unsaved")

    def _log(self, change: Transition) -> None:
        who = f" ({change.by})" if change.by else ""
        severity = Severity.WARNING if change.after in _LOUD else Severity.INFO
        text = f"{change.number}: {change.after.name.lower()}{who}: {change.reason}"
        self._context.alarm_log.log_event("downlink", text, severity)

    def _publish(self, machine: Machine, now: float) -> None:
        self._published_at = now
        status = DownlinkStatus.of(machine, now)
        self._live.show(self._context.well_now, downlink=status)
        message = status.to_message(make)
        message.header = header(self._context.now_ns(), self._node.frame(wire.RIG_FRAME))
        self._state.publish(message)
        goal = self._goal
        if goal is None:
            return
        if machine.state in ENDED:
            self._goal = None
            goal.finish(
                Downlink.Result(
                    success=machine.state == DownlinkState.CONFIRMED, message=machine.reason, state=int(machine.state)
                )
            )
            return
        goal.publish_feedback(
            Downlink.Feedback(
                state=int(machine.state),
                reason="; ".join(machine.blocked_by) or machine.reason,
                symbol=status.symbol,
                symbols=status.symbols,
                remaining=status.remaining,
            )
        )

    def diagnostics(self) -> list[Diagnostic]:
        """Return a diagnostic with the last command, or why none can be sent; an empty list without a tool file."""
        machine = self._machine
        if machine is None:
            return [] if self._refusal == _NO_TOOL else [Diagnostic("downlink", WARN, self._refusal, _RESTART)]
        level = WARN if machine.state in _LOUD else OK
        return [Diagnostic("downlink", level, machine.reason or "no command was sent yet")]
