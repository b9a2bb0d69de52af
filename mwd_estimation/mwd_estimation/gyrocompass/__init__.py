# SPDX-License-Identifier: Apache-2.0
"""Azimuth from the Earth rate: seeks, filters and their posterior."""
