# SPDX-License-Identifier: Apache-2.0
"""North references of azimuths, paths and plans."""

from __future__ import annotations

import enum


class North(enum.IntEnum):
    """North to which an azimuth refers, with the numbers of the Attitude message."""

    UNKNOWN = 0
    MAGNETIC = 1
    TRUE = 2
    GRID = 3
