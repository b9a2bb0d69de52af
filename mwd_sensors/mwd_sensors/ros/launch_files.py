# SPDX-License-Identifier: Apache-2.0
"""Launch description shared by the launch files of single nodes."""

from __future__ import annotations

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from mwd_sensors.core.stop_time import STOP_LIMIT

_RESPAWN_DELAY = 2.0  # time from the end of a node to its next start, s
_SWITCHES = ("use_sim_time", "autostart")  # launch arguments that set boolean parameters of the node


def single_node(package: str, name: str, **texts: str) -> LaunchDescription:
    """
    Return the launch description of one node of one well.

    The launch arguments are namespace, params_file (overrides the package's own file), use_sim_time, autostart and
    respawn. The executable and the default parameter file have the name of the node.

    texts : str
        Name and description of further launch arguments; each sets a text parameter of the node, empty by default. The
        user's parameter file overrides them.
    """
    defaults = PathJoinSubstitution([FindPackageShare(package), "config", f"{name}.yaml"])
    switches = {word: ParameterValue(LaunchConfiguration(word), value_type=bool) for word in _SWITCHES}
    given = {word: ParameterValue(LaunchConfiguration(word), value_type=str) for word in texts}
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="Name of the well; empty for none"),
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
                # SROS2: the node has keys and permissions of its own. Without security ROS ignores this argument.
                ros_arguments=["--enclave", PathJoinSubstitution(["/", LaunchConfiguration("namespace"), name])],
                parameters=[defaults, given, LaunchConfiguration("params_file"), switches],
                output="screen",
                respawn=LaunchConfiguration("respawn"),
                respawn_delay=_RESPAWN_DELAY,
                # A node ends itself within this time and logs where it hung. launch sends SIGTERM 5 s after SIGINT; if
                # only launch received SIGINT, SIGTERM is the first signal that the node gets.
                sigkill_timeout=str(STOP_LIMIT),
            ),
        ]
    )
