# SPDX-License-Identifier: Apache-2.0
"""Azimuth from the Earth's rotation: north seeks, their filters and the posterior of the azimuth."""
