# SPDX-License-Identifier: Apache-2.0
"""Whole jobs behind a command: simulate, calibrate, play back, supervise nodes, check the machine."""
