# SPDX-License-Identifier: Apache-2.0
"""ROS topics, messages, parameters and background work of the surface nodes."""
