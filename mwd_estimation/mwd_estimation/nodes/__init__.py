# SPDX-License-Identifier: Apache-2.0
"""The nodes of this package: the only modules that import ROS, apart from `mwd_sensors.ros`."""

from mwd_sensors.core.linear_algebra import use_one_thread

use_one_thread()
