# SPDX-License-Identifier: Apache-2.0
"""
The controller of `toolface_hold` as a node: `python toolface_hold_node.py --ros-args -r __ns:=/w1 -p wanted_deg:=60.0`.

It asks for control of the top drive, steers while it has it, and gives it back while it must not steer. It asks the
middleware for deadline and liveliness of `toolface`, so that it knows of a hung or dead MWD by itself, and prints one
line for each thing that happens: control got, lost or denied and why; steering, refusing and why, lost and how; and
where the toolface is, once in a second of the measurement.
"""

from __future__ import annotations

import math
import time
from typing import Any

import rclpy
from mwd_msgs.msg import ControlState, RigCommand, Toolface
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from toolface_hold import HoldSettings, Reading, ToolfaceHold

from mwd_sensors.ros import qos
from mwd_surface.ros.controller import Controller

PERIOD = 0.1  # s
REPORT_EVERY = 1.0  # s of the measurement
ASK_EVERY = 1.0  # s between requests for control


class ToolfaceHoldNode(Node):
    """Reads `toolface`; commands on `control/command` while it holds the lease."""

    def __init__(self) -> None:
        super().__init__("toolface_hold")
        wanted = math.radians(self.declare_parameter("wanted_deg", 0.0).value)
        self._controller = ToolfaceHold(HoldSettings(wanted))
        self._reading: Reading | None = None
        self._wanted = wanted
        self._printed = ""
        self._last_report = -math.inf
        name = self.declare_parameter("controller", "toolface_hold").value
        self._priority = self.declare_parameter("priority", 10).value
        self._asked_at = -math.inf
        self._rig = Controller(self, name)
        self.create_subscription(ControlState, "control/state", self._on_control, qos.STATE)
        watch = SubscriptionEventCallbacks(deadline=self._on_deadline, liveliness=self._on_liveliness)
        self.create_subscription(Toolface, "toolface", self._on_toolface, qos.DEADLINE_STATE, event_callbacks=watch)
        self.create_timer(PERIOD, self._act)

    def _print_change(self, words: str) -> None:
        if words != self._printed:
            self._printed = words
            print(f"{time.monotonic():.3f} {words}", flush=True)

    def _on_toolface(self, message: Toolface) -> None:
        stamp = message.header.stamp
        self._reading = Reading(
            stamp.sec + stamp.nanosec * 1e-9,
            time.monotonic(),
            message.mode,
            message.angle,
            message.sigma,
            message.rotating,
        )
        if self._reading.stamp - self._last_report >= REPORT_EVERY:
            self._last_report = self._reading.stamp
            off = math.remainder(message.angle - self._wanted, math.tau)
            print(f"{self._reading.received:.3f} at {self._last_report:.3f} off {math.degrees(off):.2f}", flush=True)

    def _on_deadline(self, _event: Any) -> None:
        self._lose("deadline missed")

    def _on_liveliness(self, event: Any) -> None:
        if event.alive_count == 0 and (event.alive_count_change < 0 or event.not_alive_count_change > 0):
            self._lose("liveliness lost")

    def _lose(self, how: str) -> None:
        self._reading = None
        print(f"{time.monotonic():.3f} {how}", flush=True)

    # Control.

    def _request(self) -> None:
        now = time.monotonic()
        if self._rig.lease or now - self._asked_at < ASK_EVERY or not self._rig.ready:
            return
        self._asked_at = now
        # The string is wound to the left too where it has turned too far.
        asked = self._rig.ask(role="toolface hold", priority=self._priority, left_turn_limit=math.radians(30.0))
        asked.add_done_callback(self._on_answer)

    def _on_answer(self, asked: Any) -> None:
        answer = asked.result()
        if not answer.success:
            self._print_control(f"no control: {answer.message}")
            return
        self._rig.lease, self._rig.sequence = answer.lease, 0
        self._print_control("has control")

    def _on_control(self, state: ControlState) -> None:
        if self._rig.lease and state.lease > self._rig.lease:
            self._rig.lease = 0
            self._print_control(f"lost control to {state.owner}")
        elif self._rig.lease and state.lease == 0 and time.monotonic() - self._asked_at > ASK_EVERY:
            self._rig.lease = 0
            self._print_control(f"lost control: {state.reason}")

    def _release(self) -> None:
        if self._rig.lease:
            self._rig.release(self._controller.why)

    def _print_control(self, words: str) -> None:
        print(f"{time.monotonic():.3f} {words}", flush=True)

    def _act(self) -> None:
        command = self._controller.update(time.monotonic(), self._reading)
        self._print_change(f"refuses: {self._controller.why}" if self._controller.why else "steers")
        if self._controller.why:
            self._release()
            return
        self._request()
        if not self._rig.lease:
            return
        if command is None:
            self._rig.heartbeat()
            return
        wanted = RigCommand(mode=command.mode, turn=command.turn, valid_for=command.valid_for)
        wanted.header.stamp.sec = int(self._reading.stamp)
        wanted.header.stamp.nanosec = int(self._reading.stamp % 1.0 * 1e9)
        wanted.header.frame_id = "rig_floor"
        self._rig.command(wanted)


def main() -> None:
    """Run until a signal."""
    rclpy.init()
    try:
        rclpy.spin(ToolfaceHoldNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        return
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
