"""The topics of one well with their types and QoS profiles: what the surface node subscribes to and records."""

from __future__ import annotations

import importlib
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from mwd_msgs import msg
from nav_msgs.msg import Path
from rcl_interfaces.msg import ParameterEvent
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu, JointState, MagneticField, Temperature
from tf2_msgs.msg import TFMessage

from mwd_sensors.ros.qos import DEADLINE_STATE, DEADLINE_STREAM, EVENT, LATCHED, STATE, STREAM

TOPICS: dict[str, tuple[Any, QoSProfile]] = {
    "imu/data_raw": (Imu, STREAM),
    "imu/mag": (MagneticField, STREAM),
    "gyro/data_raw": (Imu, STREAM),
    "imu/burst": (msg.ImuBurst, STREAM),
    "gyro/burst": (msg.ImuBurst, STREAM),
    "imu/temperature": (Temperature, STREAM),
    "truth": (msg.Truth, STREAM),
    "rig/state": (msg.RigState, EVENT),
    "rig/command": (msg.RigCommand, STATE),
    "rig/quill": (JointState, STATE),
    "gravity": (msg.Gravity, DEADLINE_STREAM),
    "attitude": (msg.Attitude, DEADLINE_STREAM),
    "imu/data": (Imu, STREAM),
    "dynamics": (msg.Dynamics, STATE),
    "interference": (msg.Interference, STATE),
    "survey": (msg.Survey, EVENT),
    "toolface": (msg.Toolface, DEADLINE_STATE),
    "survey/accepted": (msg.SurveyRecord, EVENT),
    "surveys": (msg.SurveyList, LATCHED),
    "trajectory": (msg.Trajectory, LATCHED),
    "path": (Path, LATCHED),
    "alarms": (msg.AlarmList, LATCHED),
    "recorder": (msg.RecorderStatus, STATE),
    "/tf": (TFMessage, STATE),
    "/tf_static": (TFMessage, EVENT),
    "/parameter_events": (ParameterEvent, STATE),
    "/diagnostics": (DiagnosticArray, STATE),
}


def type_name(kind: Any) -> str:
    """``package/msg/Name`` of a message class."""
    package, _, _ = kind.__module__.partition(".")
    return f"{package}/msg/{kind.__name__}"


def message_class(type_name: str) -> Any:
    """Class of ``package/msg/Name``; None where the package is not installed."""
    package, _, name = type_name.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name, None)
    except (ImportError, ValueError):
        return None


def profile_yaml(profile: QoSProfile) -> str:
    """
    Write a profile as rosbag2 does into ``offered_qos_profiles``: a list of one, in YAML.

    Without deadline and lease: a replay may be slow or paused, and promises neither.
    """
    endless = "    sec: 9223372036\n    nsec: 854775807\n"
    return (
        f"- history: {profile.history.name.lower()}\n"
        f"  depth: {profile.depth}\n"
        f"  reliability: {profile.reliability.name.lower()}\n"
        f"  durability: {profile.durability.name.lower()}\n"
        f"  deadline:\n{endless}  lifespan:\n{endless}"
        f"  liveliness: automatic\n  liveliness_lease_duration:\n{endless}"
        "  avoid_ros_namespace_conventions: false"
    )
