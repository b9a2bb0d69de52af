# SPDX-License-Identifier: Apache-2.0
"""Run one or several nodes as a process: signals, executor and an orderly shutdown."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.settings import SettingsError
from mwd_sensors.core.stop_time import STOP_PATIENCE
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_sensors.ros.refused_entity import RefusedEntityError, security_refusal
from mwd_sensors.ros.stop_signals import StopSignals, end_within, ignore, leave_background_threads

RCLError = rclpy_implementation.RCLError
# Longest wait of the executor, s. The events executor treats "no limit" as a deadline in the past.
_LONGEST_SPIN = 1e6
# Time after the shutdown of each node in which the others receive its last messages, s.
_LAST_MESSAGES = 0.5


def run_node(make_node: Callable[[], GraphNode[Any]], args: Sequence[str] | None = None) -> int:
    """Run one node until it is stopped; see `run_nodes`."""
    return run_nodes([make_node], args)


def run_nodes(make_nodes: Sequence[Callable[[], GraphNode[Any]]], args: Sequence[str] | None = None) -> int:
    """
    Run nodes in this process, one callback at a time, until one of them is stopped; shut them down in reverse order.

    A node still runs while those later in `make_nodes` shut down, so it receives their last messages, such as the
    survey that an estimator takes when it is stopped at rest.

    Discovery is limited to this machine unless ROS_AUTOMATIC_DISCOVERY_RANGE is set. Files that the process creates are
    not readable by other users.

    SIGINT and SIGTERM shut the nodes down (deactivate, clean up) and the status is 0. If the shutdown takes longer than
    `STOP_PATIENCE`, the process ends with status 1. It ends with status 2 and a message if a parameter is not allowed,
    or if the permissions of a secured node lack a topic, service or action.
    """
    # Set the range here too, for nodes that are started without `mwd run`.
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    keep_private()
    try:
        rclpy.init(args=list(args) if args is not None else None, signal_handler_options=SignalHandlerOptions.NO)
        status = _spin(make_nodes)
    except RefusedEntityError as error:
        sys.stderr.write(f"{printable(str(error))}\n")
        return 2
    except RCLError as error:
        if not (reason := security_refusal(os.environ, str(error))):
            raise
        sys.stderr.write(f"{printable(reason)}\n")
        return 2
    finally:
        rclpy.try_shutdown()
        ignore()
    leave_background_threads(status)
    return status


def keep_private() -> None:
    """Make new files of this process readable by its user and group only (0640, folders 0750), or less by the umask."""
    os.umask(os.umask(0o077) | 0o027)


def _spin(make_nodes: Sequence[Callable[[], GraphNode[Any]]]) -> int:
    nodes: list[GraphNode[Any]] = []
    stop_requested = Future()

    def stop(cause: Any = None) -> None:
        if not stop_requested.done():
            end_within(STOP_PATIENCE)
            if isinstance(cause, Future) and cause.exception() is not None:
                stop_requested.set_exception(cause.exception())
            else:
                stop_requested.set_result(None)

    signals = StopSignals(stop)
    executor = EventsExecutor()
    try:
        nodes.extend(make_node() for make_node in make_nodes)
        for node in nodes:
            node.stop_requested.add_done_callback(stop)
            executor.add_node(node)
            node.autostart()
        signals.started()
        while not stop_requested.done():
            executor.spin_until_future_complete(stop_requested, _LONGEST_SPIN)
        # If a node could not do its work, `result` raises the error that the node has set.
        stop_requested.result()
    except SettingsError as error:
        sys.stderr.write(f"{printable(str(error))}\n")
        return 2
    except ExternalShutdownException:
        nodes[0].get_logger().info("the middleware was shut down from outside")
    finally:
        for node in reversed(nodes):
            if not node.finalized:
                node.trigger_shutdown()
            executor.remove_node(node)
            node.destroy_node()
            if node is not nodes[0] and rclpy.ok():
                executor.spin_until_future_complete(Future(), _LAST_MESSAGES)
    return 0
