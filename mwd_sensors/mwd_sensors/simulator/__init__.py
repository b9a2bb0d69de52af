# SPDX-License-Identifier: Apache-2.0
"""The simulated sonde: scenario, motion, vibration, instruments, interference, faults."""
