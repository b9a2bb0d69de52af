# SPDX-License-Identifier: Apache-2.0
"""Results of the estimator as messages of the graph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from mwd_msgs.msg import Innovation as InnovationMessage
from mwd_msgs.msg import InnovationList

from mwd_estimation.core.innovations import Innovation
from mwd_sensors.core import frames
from mwd_sensors.core.arrays import Indices, Samples, Stamps
from mwd_sensors.ros.time_stamps import stamp

# Shortest time between two published estimates, ns: 0.8 ms. A unit faster than 1 kHz is estimated at its own rate.
MIN_SPACING_NS = 800_000


def innovation_message(found: Sequence[Innovation], stamp_ns: int, frame_id: str) -> InnovationList:
    """Innovations as mwd_msgs/msg/InnovationList."""
    message = InnovationList()
    message.header.stamp, message.header.frame_id = stamp(stamp_ns), frame_id
    message.sources = [InnovationMessage(test_ratio=one.test_ratio, **one._asdict()) for one in found]
    return message


def tool_transform(oriented: Any, local_frame: str, tool_frame: str) -> TransformStamped:
    """
    Transform of the tool frame from local east-north-up.

    oriented: record of `wire.IMU` with its orientation; local_frame: of the well, east-north-up; tool_frame: that of
    the tool's messages.
    """
    transform = TransformStamped()
    transform.header.stamp = stamp(int(oriented["stamp_ns"]))
    transform.header.frame_id = local_frame
    transform.child_frame_id = tool_frame
    x, y, z, w = (float(v) for v in oriented["orientation"])
    rotation = transform.transform.rotation
    rotation.x, rotation.y, rotation.z, rotation.w = x, y, z, w
    return transform


def published_rows(stamps: Stamps, last_ns: int) -> Indices:
    """
    Select the samples whose estimates are published: at least `MIN_SPACING_NS` apart.

    stamps, shape (n,), and last_ns, stamp of the one published last: ns. Time that goes back starts anew.
    """
    far = np.abs(np.diff(stamps)) >= MIN_SPACING_NS
    if len(stamps) and abs(int(stamps[0]) - last_ns) >= MIN_SPACING_NS and far.all():
        return np.arange(len(stamps))
    rows = []
    for k, stamp_ns in enumerate(stamps.tolist()):
        if abs(stamp_ns - last_ns) >= MIN_SPACING_NS:
            rows.append(k)
            last_ns = stamp_ns
    return np.array(rows, dtype=np.int64)


def oriented_imu(samples: Samples, attitude: Samples) -> Samples:
    """
    Fill in the orientation of IMU samples, tool to east-north-up (REP-103, REP-145).

    Without attitude the first covariance element is -1 (not reported); without azimuth the heading is zero with the
    variance of a full circle.
    """
    oriented = samples.copy()
    attitude_known = np.isfinite(attitude["sigma_inclination"])
    azimuth_known = np.isfinite(attitude["sigma_azimuth"])
    mat = frames.mat_nt(*(np.nan_to_num(attitude[angle]) for angle in ("inclination", "azimuth", "gravity_toolface")))
    oriented["orientation"] = np.where(attitude_known[:, None], frames.orientation_et(mat), [0.0, 0.0, 0.0, 1.0])
    tilt = attitude["sigma_inclination"] ** 2
    heading = np.where(azimuth_known, attitude["sigma_azimuth"], np.pi) ** 2
    covariance = np.zeros((len(samples), 9))
    covariance[:, 0] = np.where(attitude_known, tilt, -1.0)
    covariance[:, 4] = np.where(attitude_known, tilt, 0.0)
    covariance[:, 8] = np.where(attitude_known, heading, 0.0)
    oriented["orientation_covariance"] = covariance
    return oriented
