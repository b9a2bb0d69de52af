# SPDX-License-Identifier: Apache-2.0
"""Errors of a tool on a test bench, whose own axis is wanted, not the hole's: no alignment terms."""

from mwd_estimation.core.error_model import SensorErrors

BENCH = SensorErrors(misalignment_deg=0.0, course_misalignment_deg=0.0, sag_deg=0.0)
