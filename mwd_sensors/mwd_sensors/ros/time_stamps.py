# SPDX-License-Identifier: Apache-2.0
"""Times of the graph: nanoseconds since the epoch as messages carry them."""

from __future__ import annotations

from builtin_interfaces.msg import Time


def stamp(stamp_ns: int) -> Time:
    """ROS time of nanoseconds since the epoch."""
    return Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
