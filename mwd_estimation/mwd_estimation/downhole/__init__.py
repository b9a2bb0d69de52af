# SPDX-License-Identifier: Apache-2.0
"""What the tool sends: a state machine from flow and rotation to the words of a transmission. Imports no ROS."""
