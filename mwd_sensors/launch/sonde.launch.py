# SPDX-License-Identifier: Apache-2.0
"""Start the sonde node of one well."""

from launch import LaunchDescription
from mwd_sensors.ros.launch_files import single_node


def generate_launch_description() -> LaunchDescription:
    """Arguments: namespace, params_file, use_sim_time, autostart, wait_for_node."""
    return single_node("mwd_sensors", "sonde", wait_for_node="Node that must subscribe before the scenario starts")
