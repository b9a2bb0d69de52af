# SPDX-License-Identifier: Apache-2.0
"""Simulated rig: carry out each rig/command of the newest lease once, and acknowledge it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mwd_msgs.msg import ControlState, RigAcknowledge, RigCommand

from mwd_sensors.core import wire
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.ros import qos
from mwd_sensors.ros.diagnostics import OK, WARN, Diagnostic
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.time_stamps import stamp
from mwd_sensors.simulator import steering
from mwd_sensors.simulator.sonde import Sonde

_WORDS = {steering.HOLD: "holding", steering.ROTATE: "rotating", steering.ORIENT: "turning to an angle"}


class RigCommands:
    """
    Carries out the commands of the control authority on the simulated rig.

    Parameters
    ----------
    node : GraphNode
        Node of the simulated tool and rig.
    sonde : callable
        Returns the simulation, or None before the scenario has started.
    rate : float
        Seconds of the scenario per second of wall time; the validity of a command is in wall time of the sender.
    """

    def __init__(self, node: GraphNode[Any], sonde: Callable[[], Sonde | None], rate: float = 1.0) -> None:
        self._node, self._sonde, self._rate = node, sonde, rate if rate > 0.0 else 1.0
        self._lease = self._obeyed = self._refused = 0
        self._numbers: dict[bool, int] = {}
        self._refusal = ""
        self._answers = node.add_publisher(RigAcknowledge, "rig/acknowledge", qos.STATE)
        node.add_subscription(RigCommand, "rig/command", self.obey, qos.STATE)
        node.add_subscription(ControlState, "control/state", self.on_control, qos.STATE)

    def obey(self, message: RigCommand) -> None:
        """Carry out a command, or refuse it with the reason."""
        pumps = message.mode == steering.PUMP
        repeated = message.lease == self._lease and self._numbers.get(pumps) == message.sequence
        try:
            self._command(message, repeated=repeated)
            self._refusal = ""
        except ValueError as error:
            self._refusal = str(error)
        else:
            self._lease, self._numbers[pumps] = message.lease, message.sequence
        if repeated:
            return
        if self._refusal:
            self._refused += 1
            self._node.get_logger().warning(
                printable(f"rig/command not obeyed: {self._refusal}"), throttle_duration_sec=5.0
            )
        else:
            self._obeyed += 1
        answer = RigAcknowledge(lease=message.lease, sequence=message.sequence, message=self._refusal)
        answer.obeyed = not self._refusal
        answer.header.stamp = stamp(self._node.get_clock().now().nanoseconds)
        answer.header.frame_id = self._node.frame(wire.RIG_FRAME)
        self._answers.publish(answer)

    def on_control(self, message: ControlState) -> None:
        """Apply the torque limit of the lease in force; without a lease only the top drive's own limit applies."""
        sonde = self._sonde()
        if sonde is not None and sonde.string is not None:
            sonde.string.limit_torque(message.torque_limit if message.lease else 0.0)

    def _command(self, message: RigCommand, *, repeated: bool) -> None:
        sonde = self._sonde()
        if sonde is None:
            raise ValueError("the scenario has not started")
        if message.lease < 1 or message.sequence < 1:
            raise ValueError("lease: the rig obeys only the control authority; request a lease with request_control")
        if message.lease < self._lease:
            raise ValueError(f"lease: {message.lease} has ended; {self._lease} is in force")
        valid_for = message.valid_for * self._rate
        command = steering.Command(
            message.mode,
            message.rotary_speed,
            message.turn,
            valid_for,
            message.flow_rate,
            message.returns,
        )
        if repeated and message.mode == steering.ORIENT and sonde.string is not None:
            # A repeated turn command is not carried out again; it only extends the validity of the first.
            sonde.string.prolong(valid_for)
            return
        sonde.command(command)

    def diagnostics(self) -> Sequence[Diagnostic]:
        """Return the state of the commanded rig, if any command was received."""
        if not self._obeyed + self._refused:
            return ()
        values = (("taken", str(self._obeyed)), ("refused", str(self._refused)))
        if self._refusal:
            remedy = "correct the command; the previous one stays in force until its validity ends"
            return (Diagnostic("rig command", WARN, self._refusal, remedy, values),)
        sonde = self._sonde()
        string = sonde.string if sonde is not None else None
        mode = string.obeys if string is not None else None
        return (Diagnostic("rig command", OK, _WORDS.get(mode, "") if mode is not None else "", values=values),)
