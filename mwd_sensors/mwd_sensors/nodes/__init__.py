# SPDX-License-Identifier: Apache-2.0
"""Nodes of this package; only these nodes and `mwd_sensors.ros` import ROS."""

from mwd_sensors.core.linear_algebra import use_one_thread

use_one_thread()
