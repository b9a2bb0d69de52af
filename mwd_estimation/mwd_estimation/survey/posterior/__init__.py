# SPDX-License-Identifier: Apache-2.0
"""One posterior of a station's azimuth on the circle, from all that a run of stations shows."""
