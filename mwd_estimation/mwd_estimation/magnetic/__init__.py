# SPDX-License-Identifier: Apache-2.0
"""The magnetic field: corrections, spikes, the string's own field."""
