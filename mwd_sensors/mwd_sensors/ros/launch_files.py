# SPDX-License-Identifier: Apache-2.0
"""What the launch files of single nodes have in common: one lifecycle node with its arguments and parameter files."""

from __future__ import annotations

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from mwd_sensors.core.stop_time import STOP_LIMIT

_RESPAWN_DELAY = 2.0  # s
_SWITCHES = ("use_sim_time", "autostart")


def single_node(package: str, name: str, **texts: str) -> LaunchDescription:
    """
    Start one node of one well.

    Its arguments: namespace, params_file (laid over the package's own), use_sim_time, autostart, respawn. Executable
    and default parameter file are called as the node.

    texts : str
        Descriptions of parameters of the node, text and empty by default, that are arguments too; a parameter file
        comes before them.
    """
    defaults = PathJoinSubstitution([FindPackageShare(package), "config", f"{name}.yaml"])
    switches = {word: ParameterValue(LaunchConfiguration(word), value_type=bool) for word in _SWITCHES}
    given = {word: ParameterValue(LaunchConfiguration(word), value_type=str) for word in texts}
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="Name of the well; empty: none"),
            DeclareLaunchArgument("params_file", default_value=defaults, description="Parameter file of the node"),
            *(DeclareLaunchArgument(word, default_value="", description=about) for word, about in texts.items()),
            DeclareLaunchArgument("use_sim_time", default_value="false", description="Take the time from /clock"),
            DeclareLaunchArgument("autostart", default_value="true", description="Configure and activate at start"),
            DeclareLaunchArgument("respawn", default_value="true", description="Start the node again when it ends"),
            Node(
                package=package,
                executable=name,
                name=name,
                namespace=LaunchConfiguration("namespace"),
                parameters=[defaults, given, LaunchConfiguration("params_file"), switches],
                output="screen",
                respawn=LaunchConfiguration("respawn"),
                respawn_delay=_RESPAWN_DELAY,
                # A node ends itself by then at the latest, and says where it hung. SIGTERM comes after launch's 5 s:
                # where launch alone gets SIGINT, it is the first signal of the node.
                sigkill_timeout=str(STOP_LIMIT),
            ),
        ]
    )
