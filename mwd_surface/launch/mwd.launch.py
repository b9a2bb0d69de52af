# SPDX-License-Identifier: Apache-2.0
"""Start estimator and surface of one well, and what measures: the simulated sonde, a probe, or the driver of others."""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import EnvironmentVariable, EqualsSubstitution, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import SetRemap
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

# Room in Fast DDS for streams at a kilohertz; a profile of one's own comes first, other middleware reads none.
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
NODES = {"surface": "mwd_surface", "estimator": "mwd_estimation", "sonde": "mwd_sensors", "probe": "mwd_sensors"}
# Which node a source of samples needs; topics: none, a driver publishes them.
SOURCES = {"simulated": "sonde", "probe": "probe", "topics": ""}
# Arguments that name the topics of a driver, and the topics that they stand for.
TOPICS = {"imu": "imu/data_raw", "mag": "imu/mag", "gyro": "gyro/data_raw", "temperature": "imu/temperature"}


def generate_launch_description() -> LaunchDescription:
    """
    Describe the graph.

    Arguments: source, with imu, mag, gyro and temperature where it is topics; namespace, use_sim_time, autostart,
    params_file for all nodes, <node>_params_file for one of them.
    """
    config = [FindPackageShare("mwd_surface"), "config"]
    ours = PathJoinSubstitution([*config, "fastdds.xml"])
    # A file has a section a node; the surface's own defaults, which it reads anyway, say nothing to the others.
    nothing_more = PathJoinSubstitution([*config, "surface.yaml"])
    actions = [
        SetEnvironmentVariable(PROFILES, EnvironmentVariable(PROFILES, default_value=[ours])),
        DeclareLaunchArgument("params_file", default_value=nothing_more, description="Parameter file of all nodes"),
        DeclareLaunchArgument(
            "source",
            default_value="simulated",
            choices=list(SOURCES),
            description="What measures: the simulated sonde, a probe on a serial line, or topics of another driver",
        ),
        DeclareLaunchArgument("namespace", default_value="", description="Name of the well; empty: none"),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="Take the time from /clock"),
        DeclareLaunchArgument("autostart", default_value="true", description="Configure and activate at start"),
    ]
    for argument, topic in TOPICS.items():
        description = f"Topic of the driver in place of {topic}"
        actions += [
            DeclareLaunchArgument(argument, default_value=topic, description=description),
            SetRemap(topic, LaunchConfiguration(argument)),
        ]
    # All arguments before the first file: what is set for an included file stays set after it.
    actions += [
        DeclareLaunchArgument(
            f"{node}_params_file",
            default_value=LaunchConfiguration("params_file"),
            description=f"Parameter file of the {node} node, in place of params_file",
        )
        for node in NODES
    ]
    source_of = {node: source for source, node in SOURCES.items()}
    for node, package in NODES.items():
        share = FindPackageShare(package)
        wanted = EqualsSubstitution(LaunchConfiguration("source"), source_of.get(node, LaunchConfiguration("source")))
        actions.append(
            IncludeLaunchDescription(
                PathJoinSubstitution([share, "launch", f"{node}.launch.py"]),
                launch_arguments={
                    "namespace": LaunchConfiguration("namespace"),
                    "use_sim_time": LaunchConfiguration("use_sim_time"),
                    "autostart": LaunchConfiguration("autostart"),
                    "params_file": LaunchConfiguration(f"{node}_params_file"),
                    # The first time the estimator compiles its filters for a minute or two.
                    **({"wait_for_node": "estimator"} if node == "sonde" else {}),
                }.items(),
                condition=IfCondition(wanted),
            )
        )
    return LaunchDescription(actions)
