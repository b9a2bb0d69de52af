# SPDX-License-Identifier: Apache-2.0
"""Survey list, well path, alarms and recorder state between the surface's own objects and the graph's messages."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from mwd_msgs import msg
from nav_msgs.msg import Path

from mwd_sensors.core import frames
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.live.alarms import Alarm
from mwd_surface.surveys.message_conversion import fill_list, fill_record, fill_trajectory
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import SurveyRecord
from mwd_surface.trajectory.well_path import Definitive


def record_message(record: SurveyRecord) -> msg.SurveyRecord:
    """Message of a line of the survey list."""
    message = msg.SurveyRecord()
    fill_record(message, record, msg.AzimuthEstimate)
    return message


def list_message(surveys: SurveyList, frame_id: str) -> msg.SurveyList:
    """Message of the whole list."""
    message = msg.SurveyList()
    message.header.frame_id = frame_id
    fill_list(message, surveys, msg.SurveyRecord, msg.AzimuthEstimate, msg.Leg, msg.Remark)
    return message


def trajectory_message(path: Definitive, changed_ns: int, frame_id: str) -> msg.Trajectory:
    """Message of the well path."""
    message = msg.Trajectory()
    message.header.frame_id = frame_id
    fill_trajectory(message, path, changed_ns)
    return message


def path_message(path: Definitive, changed_ns: int, frame_id: str) -> Path:
    """Convert the well path to nav_msgs/Path in east-north-up, x of each pose down-hole."""
    message = Path()
    message.header.stamp = stamp(changed_ns)
    message.header.frame_id = frame_id
    orientations = frames.orientation_et(frames.mat_nt(path.inclination, path.azimuth, np.pi))
    for position, orientation in zip(path.positions @ frames.MAT_EN.T, orientations, strict=True):
        pose = PoseStamped(header=message.header)
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = (float(v) for v in position)
        turned = pose.pose.orientation
        turned.x, turned.y, turned.z, turned.w = (float(v) for v in orientation)
        message.poses.append(pose)
    return message


def alarm_message(alarm: Alarm) -> msg.Alarm:
    """Message of an alarm."""
    return msg.Alarm(
        raised=stamp(alarm.raised_ns),
        last=stamp(alarm.last_ns),
        id=alarm.id,
        severity=alarm.severity,
        text=alarm.text,
        remedy=alarm.remedy,
        active=alarm.active,
        acknowledged=alarm.acknowledged,
        count=alarm.count,
    )


def recorder_message(status: RecorderStatus, now: Time) -> msg.RecorderStatus:
    """Message of the recorder's state."""
    message = msg.RecorderStatus(
        state=int(status.state),
        path=str(status.path or ""),
        messages=status.messages,
        bytes=status.bytes,
        dropped=status.dropped,
        free_bytes=max(status.free_bytes, 0),
        duration=status.duration_s,
        reason=status.reason,
    )
    message.header.stamp = now
    return message
