# SPDX-License-Identifier: Apache-2.0
"""Sensor health: which unit or axis reads wrongly, and why."""
