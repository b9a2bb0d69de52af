# SPDX-License-Identifier: Apache-2.0
"""Transmission of the tool: a state machine that converts flow, rotation and measurements to telemetry words."""
