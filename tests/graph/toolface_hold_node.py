"""
The controller of `toolface_hold` as a node: `python toolface_hold_node.py --ros-args -r __ns:=/w1 -p wanted_deg:=60.0`.

It asks the middleware for deadline and liveliness of `toolface`, so that it knows of a hung or dead MWD by itself, and
prints one line for each thing that happens: steering, refusing and why, lost and how; and where the toolface is, once
in a second of the measurement.
"""

from __future__ import annotations

import math
import time
from typing import Any

import rclpy
from mwd_msgs.msg import RigCommand, Toolface
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from toolface_hold import HoldSettings, Reading, ToolfaceHold

from mwd_sensors.ros import qos

PERIOD = 0.1  # s
REPORT_EVERY = 1.0  # s of the measurement


class ToolfaceHoldNode(Node):
    """Reads `toolface`, commands `rig/command`."""

    def __init__(self) -> None:
        super().__init__("toolface_hold")
        wanted = math.radians(self.declare_parameter("wanted_deg", 0.0).value)
        self._controller = ToolfaceHold(HoldSettings(wanted))
        self._reading: Reading | None = None
        self._wanted = wanted
        self._printed = ""
        self._last_report = -math.inf
        self._out = self.create_publisher(RigCommand, "rig/command", qos.STATE)
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

    def _act(self) -> None:
        command = self._controller.update(time.monotonic(), self._reading)
        self._print_change(f"refuses: {self._controller.why}" if self._controller.why else "steers")
        if command is None:
            return
        message = RigCommand(mode=command.mode, turn=command.turn, valid_for=command.valid_for)
        message.header.stamp.sec = int(self._reading.stamp)
        message.header.stamp.nanosec = int(self._reading.stamp % 1.0 * 1e9)
        message.header.frame_id = "rig_floor"
        self._out.publish(message)


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
