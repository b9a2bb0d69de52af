# SPDX-License-Identifier: Apache-2.0
"""Frames, Earth models, message layouts, calibration, the simulated sonde and the base class of the nodes."""
