# SPDX-License-Identifier: Apache-2.0
"""Frames, Earth models, wire layouts, calibration, the simulated sonde and the base class of the nodes."""
