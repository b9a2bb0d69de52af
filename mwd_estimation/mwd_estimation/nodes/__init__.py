# SPDX-License-Identifier: Apache-2.0
"""The ROS nodes of this package. Only this subpackage and `mwd_sensors.ros` import ROS."""

from mwd_sensors.core.linear_algebra import use_one_thread

use_one_thread()
