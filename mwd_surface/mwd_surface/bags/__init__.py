# SPDX-License-Identifier: Apache-2.0
"""Recordings: reading, writing while they happen, and recovery of damaged ones."""
