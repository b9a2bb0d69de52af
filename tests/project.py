# SPDX-License-Identifier: Apache-2.0
"""Where the repository keeps what tests and benchmarks read."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SCENARIOS = ROOT / "bags" / "scenarios"
GOLDEN = ROOT / "bags" / "golden"
REFERENCE_DATA = ROOT / "bags" / "reference_data"
MESSAGES = ROOT / "mwd_msgs" / "msg"
# Packages that come with ROS: package.xml names them, no Python index has them.
ROS = {
    "ament_index_python",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "launch",
    "launch_ros",
    "lifecycle_msgs",
    "mwd_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "rosgraph_msgs",
    "rosidl_runtime_py",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "tf2_msgs",
}
