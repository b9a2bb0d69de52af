# SPDX-License-Identifier: Apache-2.0
"""Topics of one well with their types and QoS profiles, to which the surface node subscribes and which it records."""

from __future__ import annotations

import importlib
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from mwd_msgs import msg
from nav_msgs.msg import Path
from rcl_interfaces.msg import ParameterEvent
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu, JointState, MagneticField, Temperature
from tf2_msgs.msg import TFMessage

from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.ros.qos import DEADLINE_STATE, DEADLINE_STREAM, EVENT, LATCHED, STATE, STREAM, offered
from mwd_surface.bags.bag_metadata import qos_profile, qos_text

TOPICS: dict[str, tuple[Any, QoSProfile]] = {
    "imu/data_raw": (Imu, STREAM),
    "imu/mag": (MagneticField, STREAM),
    "gyro/data_raw": (Imu, STREAM),
    "imu/burst": (msg.ImuBurst, STREAM),
    "gyro/burst": (msg.ImuBurst, STREAM),
    "imu/temperature": (Temperature, STREAM),
    "gamma/counts": (msg.DetectorCounts, STREAM),
    "truth": (msg.Truth, STREAM),
    "rig/state": (msg.RigState, EVENT),
    "control/command": (msg.SealedCommand, STATE),
    "control/state": (msg.ControlState, STATE),
    "rig/command": (msg.RigCommand, STATE),
    "rig/acknowledge": (msg.RigAcknowledge, STATE),
    "rig/quill": (JointState, STATE),
    "rig/standpipe": (msg.PressureBurst, EVENT),
    "rig/standpipe_2": (msg.PressureBurst, EVENT),
    "rig/strokes": (msg.StrokeBurst, EVENT),
    "rig/earth_voltage": (msg.VoltageBurst, EVENT),
    "rig/coil_voltage": (msg.VoltageBurst, EVENT),
    "rig/serial": (msg.SerialBurst, EVENT),
    "tool/flow": (msg.ToolFlow, EVENT),
    "tool/status": (msg.ToolStatus, STREAM),
    "tool/transmission": (msg.Transmission, EVENT),
    "link/word": (msg.LinkWord, EVENT),
    "link/frame": (msg.LinkFrame, EVENT),
    "link/quality": (msg.LinkQuality, STATE),
    "link/attitude": (msg.Attitude, STATE),
    "link/survey": (msg.Survey, EVENT),
    "link/log": (msg.LogSample, EVENT),
    "downlink/state": (msg.DownlinkState, EVENT),
    "gravity": (msg.Gravity, DEADLINE_STREAM),
    "attitude": (msg.Attitude, DEADLINE_STREAM),
    "imu/data": (Imu, STREAM),
    "dynamics": (msg.Dynamics, STATE),
    "log": (msg.LogSample, EVENT),
    "interference": (msg.Interference, STATE),
    "innovations": (msg.InnovationList, STATE),
    "used_samples": (msg.UsedSamples, STATE),
    "operator_events": (msg.OperatorEvent, STATE),
    "survey": (msg.Survey, EVENT),
    "survey/revised": (msg.Survey, EVENT),
    "toolface": (msg.Toolface, DEADLINE_STATE),
    "survey/accepted": (msg.SurveyRecord, EVENT),
    "surveys": (msg.SurveyList, LATCHED),
    "trajectory": (msg.Trajectory, LATCHED),
    "path": (Path, LATCHED),
    "steering/advice": (msg.SteeringAdvice, LATCHED),
    "alarms": (msg.AlarmList, LATCHED),
    "events": (msg.Event, EVENT),
    "recorder": (msg.RecorderStatus, STATE),
    "inputs": (msg.InputList, STATE),
    "heartbeat": (DiagnosticStatus, STATE),
    "/tf": (TFMessage, STATE),
    "/tf_static": (TFMessage, EVENT),
    "/parameter_events": (ParameterEvent, STATE),
    "/diagnostics": (DiagnosticArray, STATE),
}


# Topics that only the surface node publishes.
OF_SURFACE = frozenset(
    {
        *("toolface", "survey/accepted", "surveys", "trajectory", "path", "steering/advice", "alarms", "events"),
        *("recorder", "inputs", "control/state", "downlink/state"),
    }
)

# Topics of the tool; a surface that receives the tool over a telemetry link does not subscribe to these topics.
OF_TOOL = (
    *("imu/data_raw", "imu/mag", "gyro/data_raw", "imu/burst", "gyro/burst", "imu/temperature", "truth", "tool/flow"),
    *("gamma/counts", "log", "tool/status"),
    *("tool/transmission", "gravity", "attitude", "imu/data", "dynamics", "interference", "innovations", "survey"),
    *("survey/revised", "used_samples", "/tf"),
)


def type_name(kind: Any) -> str:
    """Return ``package/msg/Name`` of a message class."""
    package, _, _ = kind.__module__.partition(".")
    return f"{package}/msg/{kind.__name__}"


def message_class(type_name: str) -> Any:
    """Return the class of ``package/msg/Name``; None if the package is not installed or has no such message."""
    package, _, name = type_name.partition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name, None)
    except (ImportError, ValueError):
        return None


def profile_yaml(profile: QoSProfile) -> str:
    """
    Return a publisher's offered profile in the form of rosbag2's ``offered_qos_profiles``: a YAML list of one profile.

    The profile includes deadline and liveliness lease, so that a replay fits subscriptions that require them.
    """
    offer = offered(profile)
    table = qos_profile(offer.reliability.name.lower(), offer.durability.name.lower(), depth=offer.depth)
    for name, duration in (
        ("deadline", offer.deadline),
        ("liveliness_lease_duration", offer.liveliness_lease_duration),
    ):
        # Zero means no limit, which is the table's default.
        if duration.nanoseconds:
            seconds, rest = divmod(duration.nanoseconds, NANOSECONDS)
            table[name] = {"sec": seconds, "nsec": rest}
    return qos_text([table])
