# SPDX-License-Identifier: Apache-2.0
"""Words from pressure pulses: sync, clock, channel response and packets."""
