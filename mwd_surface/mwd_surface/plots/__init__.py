# SPDX-License-Identifier: Apache-2.0
"""Plots of recordings, surveys and forecasts; plots of recordings need constant memory."""
