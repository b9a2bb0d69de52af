# SPDX-License-Identifier: Apache-2.0
"""Gravity in tool axes while the string rotates and vibrates: one module per method."""
