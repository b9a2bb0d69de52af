# SPDX-License-Identifier: Apache-2.0
"""Recordings: reading, crash-safe writing, and recovery of damaged recordings."""
