# SPDX-License-Identifier: Apache-2.0
"""
Start estimator and surface of one well, and a source of samples: simulated sonde, probe, or another driver's topics.
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, SetEnvironmentVariable
from launch.conditions import IfCondition
from launch.substitutions import EnvironmentVariable, EqualsSubstitution, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import SetRemap
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

# Profile of Fast DDS with buffers for streams at 1 kHz. A profile that the user has set has precedence; other
# middleware ignores the variable.
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
NODES = {"surface": "mwd_surface", "estimator": "mwd_estimation", "sonde": "mwd_sensors", "probe": "mwd_sensors"}
# Node that each source of samples needs; "topics" needs none, because a driver publishes the topics.
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
    # A parameter file has one section for each node. The default file contains only the defaults of the surface node,
    # so it changes nothing.
    nothing_more = PathJoinSubstitution([*config, "surface.yaml"])
    actions = [
        SetEnvironmentVariable(PROFILES, EnvironmentVariable(PROFILES, default_value=[ours])),
        DeclareLaunchArgument("params_file", default_value=nothing_more, description="Parameter file of all nodes"),
        DeclareLaunchArgument(
            "source",
            default_value="simulated",
            choices=list(SOURCES),
            description="Source of the samples: simulated sonde, probe on a serial line, or topics of another driver",
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
    # Declare all arguments before the first included file, because values set for an included file stay set after it.
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
                    # At the first start the estimator compiles its filters, which takes one or two minutes.
                    **({"wait_for_node": "estimator"} if node == "sonde" else {}),
                }.items(),
                condition=IfCondition(wanted),
            )
        )
    return LaunchDescription(actions)
