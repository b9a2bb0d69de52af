"""Start sonde, estimator and surface of one well."""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, SetEnvironmentVariable
from launch.substitutions import EnvironmentVariable, LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

# Room in Fast DDS for streams at a kilohertz; a profile of one's own comes first, other middleware reads none.
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
NODES = {"surface": "mwd_surface", "estimator": "mwd_estimation", "sonde": "mwd_sensors"}


def generate_launch_description() -> LaunchDescription:
    """Arguments: namespace, use_sim_time, autostart, and <node>_params_file for each node."""
    ours = PathJoinSubstitution([FindPackageShare("mwd_surface"), "config", "fastdds.xml"])
    actions = [
        SetEnvironmentVariable(PROFILES, EnvironmentVariable(PROFILES, default_value=[ours])),
        DeclareLaunchArgument("namespace", default_value="", description="Name of the well; empty: none"),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="Take the time from /clock"),
        DeclareLaunchArgument("autostart", default_value="true", description="Configure and activate at start"),
    ]
    for node, package in NODES.items():
        share = FindPackageShare(package)
        actions += [
            DeclareLaunchArgument(
                f"{node}_params_file",
                default_value=PathJoinSubstitution([share, "config", f"{node}.yaml"]),
                description=f"Parameter file of the {node} node",
            ),
            IncludeLaunchDescription(
                PathJoinSubstitution([share, "launch", f"{node}.launch.py"]),
                launch_arguments={
                    "namespace": LaunchConfiguration("namespace"),
                    "use_sim_time": LaunchConfiguration("use_sim_time"),
                    "autostart": LaunchConfiguration("autostart"),
                    "params_file": LaunchConfiguration(f"{node}_params_file"),
                }.items(),
            ),
        ]
    return LaunchDescription(actions)
