"""`mwd node`: one node of the graph in this process, as `ros2 run` would start it."""

from __future__ import annotations

import enum
import sys

import typer


class Node(enum.StrEnum):
    """The nodes of the graph."""

    SONDE = "sonde"
    ESTIMATOR = "estimator"
    SURFACE = "surface"


MODULES = {
    Node.SONDE: "mwd_sensors.nodes.sonde",
    Node.ESTIMATOR: "mwd_estimation.nodes.estimator",
    Node.SURFACE: "mwd_surface.nodes.surface",
}
PASS_ON = {"allow_extra_args": True, "ignore_unknown_options": True}


def node(context: typer.Context, name: Node) -> None:
    """
    Run one node, as `ros2 run` does; what follows its name goes to ROS.

    \b
    Examples:
      mwd node sonde
      mwd node estimator --ros-args -r __ns:=/well_2 -p method:=s3
      mwd node surface --ros-args --params-file surface.yaml
    """
    import importlib

    try:
        module = importlib.import_module(MODULES[name])
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in ("rclpy", "mwd_msgs", "rcl_interfaces", "sensor_msgs"):
            raise
        raise OSError(f"{error.name} is not installed here: `mwd doctor` says how to get it") from error
    sys.exit(module.main([name.value, *context.args]))
