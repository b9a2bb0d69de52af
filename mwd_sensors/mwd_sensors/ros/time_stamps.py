# SPDX-License-Identifier: Apache-2.0
"""Conversion of nanoseconds since 1970 to the time and the header of ROS messages."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from std_msgs.msg import Header


def stamp(stamp_ns: int) -> Time:
    """Convert nanoseconds since 1970 to a ROS time."""
    return Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)


def header(stamp_ns: int, frame_id: str = "") -> Header:
    """Return a message header with a stamp, ns since 1970, and a frame."""
    return Header(stamp=stamp(stamp_ns), frame_id=frame_id)
