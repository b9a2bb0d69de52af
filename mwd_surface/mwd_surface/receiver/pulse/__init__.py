# SPDX-License-Identifier: Apache-2.0
"""Words from pressure pulses: sync, clock, response of the channel, packets."""
