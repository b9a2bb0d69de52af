# SPDX-License-Identifier: Apache-2.0
"""Downlink at the surface: permission to send a command to the tool, interlocks, sending, and the tool's answer."""
