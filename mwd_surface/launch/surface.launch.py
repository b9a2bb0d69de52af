"""Start the surface node of one well."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Arguments: namespace, params_file, use_sim_time, autostart."""
    defaults = PathJoinSubstitution([FindPackageShare("mwd_surface"), "config", "surface.yaml"])
    switches = ("use_sim_time", "autostart")
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="Name of the well; empty: none"),
            DeclareLaunchArgument("params_file", default_value=defaults, description="Parameter file of the node"),
            DeclareLaunchArgument("use_sim_time", default_value="false", description="Take the time from /clock"),
            DeclareLaunchArgument("autostart", default_value="true", description="Configure and activate at start"),
            Node(
                package="mwd_surface",
                executable="surface",
                name="surface",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    defaults,
                    LaunchConfiguration("params_file"),
                    {name: ParameterValue(LaunchConfiguration(name), value_type=bool) for name in switches},
                ],
                output="screen",
            ),
        ]
    )
