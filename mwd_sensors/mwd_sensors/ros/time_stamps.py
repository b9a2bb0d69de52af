# SPDX-License-Identifier: Apache-2.0
"""Conversion of nanoseconds since 1970 to the time in ROS messages."""

from __future__ import annotations

from builtin_interfaces.msg import Time


def stamp(stamp_ns: int) -> Time:
    """Return the ROS time of nanoseconds since 1970."""
    return Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
