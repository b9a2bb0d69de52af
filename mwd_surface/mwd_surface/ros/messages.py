# SPDX-License-Identifier: Apache-2.0
"""ROS messages of the well path and of the recorder's state."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from mwd_msgs import msg
from nav_msgs.msg import Path

from mwd_sensors.core import frames
from mwd_sensors.ros.messages import make
from mwd_sensors.ros.time_stamps import header, stamp
from mwd_surface.bags.recorder.status import RecorderStatus
from mwd_surface.trajectory.well_path import Definitive


def path_message(path: Definitive, changed_ns: int, frame_id: str) -> Path:
    """Return the well path as nav_msgs/Path in east-north-up, with x of each pose downhole."""
    message = Path(header=header(changed_ns, frame_id))
    orientations = frames.orientation_et(frames.mat_nt(path.inclination, path.azimuth, np.pi))
    for position, orientation in zip(path.positions @ frames.MAT_EN.T, orientations, strict=True):
        pose = PoseStamped(header=message.header)
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = (float(v) for v in position)
        turned = pose.pose.orientation
        turned.x, turned.y, turned.z, turned.w = (float(v) for v in orientation)
        message.poses.append(pose)
    return message


def recorder_message(status: RecorderStatus, now: Time, streams: Mapping[str, int]) -> msg.RecorderStatus:
    """Return the message of the recorder's state; streams: first stamp, ns, of each recorded topic of samples."""
    message = status.to_message(make)
    message.header.stamp = now
    message.streams, message.first = list(streams), [stamp(first_ns) for first_ns in streams.values()]
    return message
