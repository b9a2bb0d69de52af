# SPDX-License-Identifier: Apache-2.0
"""Calibration of a tool: Allan variance, tumble fit, compensation of a stream."""
