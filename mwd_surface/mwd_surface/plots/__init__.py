# SPDX-License-Identifier: Apache-2.0
"""Plots of recordings, surveys and forecasts; the memory for a plot does not depend on the length of the recording."""
