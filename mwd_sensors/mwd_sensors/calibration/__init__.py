# SPDX-License-Identifier: Apache-2.0
"""Calibration of a tool: Allan variance, fit of a tumble run, correction of samples."""
