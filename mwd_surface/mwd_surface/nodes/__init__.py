# SPDX-License-Identifier: Apache-2.0
"""ROS nodes of this package, and the parts of the surface node."""

from mwd_sensors.core.linear_algebra import use_one_thread

use_one_thread()
