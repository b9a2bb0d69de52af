# SPDX-License-Identifier: Apache-2.0
"""Transmission of the tool: a state machine that turns flow, rotation and measurements into words. Imports no ROS."""
