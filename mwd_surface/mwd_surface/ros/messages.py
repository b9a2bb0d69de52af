# SPDX-License-Identifier: Apache-2.0
"""Messages of the surface: survey list, path, alarms, events, inputs, advice, state of the recorder."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from mwd_msgs import msg
from nav_msgs.msg import Path

from mwd_sensors.core import frames
from mwd_sensors.core.unknown import or_nan
from mwd_sensors.ros.time_stamps import stamp
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.live.alarms import Alarm, Event
from mwd_surface.live.inputs import InputTable
from mwd_surface.trajectory.advice import Advice
from mwd_surface.trajectory.well_path import Definitive


def path_message(path: Definitive, changed_ns: int, frame_id: str) -> Path:
    """Return the well path as nav_msgs/Path in east-north-up, with x of each pose downhole."""
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
    """Return the message of an alarm."""
    return msg.Alarm(
        raised=stamp(alarm.raised_ns),
        last=stamp(alarm.last_ns),
        id=alarm.id,
        severity=alarm.severity,
        text=alarm.text,
        remedy=alarm.remedy,
        active=alarm.active,
        acknowledged=alarm.acknowledged,
        acknowledged_by=alarm.acknowledged_by,
        count=alarm.count,
    )


def recorder_message(status: RecorderStatus, now: Time, streams: Mapping[str, int]) -> msg.RecorderStatus:
    """Return the message of the recorder's state; streams: first stamp, ns, of each recorded topic of samples."""
    message = msg.RecorderStatus(
        state=int(status.state),
        path=str(status.path or ""),
        messages=status.messages,
        bytes=status.bytes,
        dropped=status.dropped,
        free_bytes=float(status.free_bytes),
        duration=status.duration_s,
        reason=status.reason,
        streams=list(streams),
        first=[stamp(first_ns) for first_ns in streams.values()],
    )
    message.header.stamp = now
    return message


def event_message(event: Event) -> msg.Event:
    """Return the message of a line of the log."""
    message = msg.Event(kind=event.kind, source=event.source, text=event.text, severity=event.severity)
    message.header.stamp = stamp(event.stamp_ns)
    return message


def inputs_message(table: InputTable) -> msg.InputList:
    """Return the message of the inputs, without its header."""
    rows = [
        msg.InputState(
            name=row.name,
            clock=int(row.clock),
            clock_offset=or_nan(row.clock_offset),
            offset_age=or_nan(row.offset_age),
            data_age=or_nan(row.data_age),
            role=int(row.role),
            priority=row.priority,
            bit_depth=or_nan(row.bit_depth),
            reason=row.reason,
        )
        for row in table.inputs
    ]
    return msg.InputList(
        inputs=rows,
        depth_source=table.depth_source,
        depth_age=or_nan(table.depth_age),
        depth_difference=or_nan(table.depth_difference),
    )


def advice_message(advice: Advice) -> msg.SteeringAdvice:
    """Return the message of an advice, without its header."""
    return msg.SteeringAdvice(
        mode=int(advice.mode),
        toolface_mode=msg.Toolface.MAGNETIC if advice.magnetic else msg.Toolface.GRAVITY,
        toolface=or_nan(advice.toolface),
        limit=advice.limit,
        sigma=or_nan(advice.sigma),
        confidence=or_nan(advice.confidence),
        from_depth=or_nan(advice.from_depth),
        slide_to_depth=or_nan(advice.slide_to_depth),
        to_depth=or_nan(advice.to_depth),
        valid_for=math.nan,
        dogleg_severity=or_nan(advice.dogleg_severity),
        motor_yield=or_nan(advice.motor_yield),
        survey=advice.survey,
        source=advice.source,
        reason=advice.reason,
    )
