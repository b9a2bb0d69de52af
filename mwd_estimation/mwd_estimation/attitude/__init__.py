# SPDX-License-Identifier: Apache-2.0
"""Attitude of every sample between and during surveys."""
