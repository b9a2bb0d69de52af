# SPDX-License-Identifier: Apache-2.0
"""Downlink at the surface: who may send a command to the tool, when, and how it ends."""
