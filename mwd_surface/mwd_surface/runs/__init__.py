# SPDX-License-Identifier: Apache-2.0
"""Whole jobs that a command starts: simulate, calibrate, play back, supervise nodes, look at the machine."""
