# SPDX-License-Identifier: Apache-2.0
"""Drivers of real sensors: what their serial lines carry, their clocks, and an emulator that plays recordings."""
