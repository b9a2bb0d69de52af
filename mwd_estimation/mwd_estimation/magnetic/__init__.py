# SPDX-License-Identifier: Apache-2.0
"""Magnetic field: axial correction, spike filter, and the interference of the drill string."""
