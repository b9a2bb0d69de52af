# SPDX-License-Identifier: Apache-2.0
"""Simulated sonde: scenario, motion, vibration, instruments, interference, faults and telemetry link."""
