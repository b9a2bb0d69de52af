# SPDX-License-Identifier: Apache-2.0
"""Downlink at the surface: who may send a command to the tool, when it may be sent, and how it ends."""
