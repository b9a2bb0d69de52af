# SPDX-License-Identifier: Apache-2.0
"""Which north an azimuth, a path or a plan is from."""

from __future__ import annotations

import enum


class North(enum.IntEnum):
    """Which north an azimuth is from; the numbers of the Attitude message."""

    UNKNOWN = 0
    MAGNETIC = 1
    TRUE = 2
    GRID = 3
