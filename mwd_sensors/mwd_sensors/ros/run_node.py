"""Run one node as a process: signals, executor and an orderly shutdown."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from mwd_sensors.core.settings import SettingsError
from mwd_sensors.ros.lifecycle_node import GraphNode

# Longest wait of the executor, s. The events executor treats "no limit" as a deadline that has passed.
_LONGEST_SPIN = 1e6


def run_node(make_node: Callable[[], GraphNode[Any]], args: Sequence[str] | None = None) -> int:
    """
    Run one node until it is stopped.

    SIGINT and SIGTERM end it in order (deactivate, clean up) with status 0; parameters that are not allowed end it with
    status 2 and one sentence.
    """
    rclpy.init(args=list(args) if args is not None else None, signal_handler_options=SignalHandlerOptions.NO)
    try:
        return _spin(make_node)
    finally:
        rclpy.try_shutdown()


def _spin(make_node: Callable[[], GraphNode[Any]]) -> int:
    try:
        node = make_node()
    except SettingsError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    stop_requested = node.stop_requested

    def on_signal(_number: int, _frame: Any) -> None:
        if not stop_requested.done():
            stop_requested.set_result(None)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        node.autostart()
        while not stop_requested.done():
            executor.spin_until_future_complete(stop_requested, _LONGEST_SPIN)
    except ExternalShutdownException:
        node.get_logger().info("the middleware was shut down from outside")
    finally:
        if not node.finalized:
            node.trigger_shutdown()
        executor.remove_node(node)
        node.destroy_node()
    return 0
