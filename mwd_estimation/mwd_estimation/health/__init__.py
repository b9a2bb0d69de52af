# SPDX-License-Identifier: Apache-2.0
"""Sensor health: find which unit or axis reads wrong values, and why."""
