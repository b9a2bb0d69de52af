# SPDX-License-Identifier: Apache-2.0
"""`mwd node`: run one node of the graph in this process, like `ros2 run`."""

from __future__ import annotations

import contextlib
import enum
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Annotated

import typer


class Node(enum.StrEnum):
    """Node of the ROS graph; `well` is sonde, estimator and surface in one process."""

    SONDE = "sonde"
    PROBE = "probe"
    ESTIMATOR = "estimator"
    SURFACE = "surface"
    RECEIVER = "receiver"
    WELL = "well"


MODULES = {
    Node.SONDE: "mwd_sensors.nodes.sonde",
    Node.PROBE: "mwd_sensors.nodes.probe",
    Node.ESTIMATOR: "mwd_estimation.nodes.estimator",
    Node.SURFACE: "mwd_surface.nodes.surface",
    Node.RECEIVER: "mwd_surface.nodes.receiver",
    Node.WELL: "mwd_surface.nodes.well",
}
_ROS_PACKAGES = ("rclpy", "mwd_msgs", "rcl_interfaces", "sensor_msgs", "rosgraph_msgs", "std_srvs", "tf2_msgs")


def node(
    context: typer.Context,
    name: Annotated[Node, typer.Argument(help="Node to run; well: sonde, estimator and surface in one process.")],
) -> None:
    """
    Run one node, like `ros2 run`; arguments after the node's name are passed to ROS.

    \b
    Examples:
      mwd node sonde
      mwd node estimator --ros-args -r __ns:=/well_2 -p method:=s3
      mwd node surface --ros-args --params-file surface.yaml
    """
    from mwd_surface.runs.supervise import die_with_supervisor

    die_with_supervisor(os.environ)
    sys.exit(node_main(MODULES[name])([name.value, *context.args]))


def node_main(module: str) -> Callable[[Sequence[str]], int]:
    """
    Return the main function of a node.

    The middleware is configured for messages at high rates, unless the user has set a profile.

    Raises
    ------
    OSError
        ROS is not installed for this Python.
    """
    import importlib

    from mwd_surface.runs.launch_plan import MIDDLEWARE, PROFILES

    os.environ.setdefault(PROFILES, str(MIDDLEWARE))
    with without_ros():
        main: Callable[[Sequence[str]], int] = importlib.import_module(module).main
    return main


@contextlib.contextmanager
def without_ros() -> Iterator[None]:
    """Context in which the import of a ROS package that is not installed raises OSError with a remedy."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in _ROS_PACKAGES:
            raise
        raise OSError(f"{error.name} is not installed for this Python: `mwd doctor` shows how to install it") from error
