# SPDX-License-Identifier: Apache-2.0
"""Status bits of an attitude sample, and their names."""

from __future__ import annotations

from enum import IntFlag


class Status(IntFlag):
    """Bits of mwd_msgs/msg/Attitude.status; several may be set. That file explains each of them."""

    INITIALISING = 1
    STILL = 2
    ROTATING = 4
    CLIPPED = 8
    GAP = 16
    NEAR_VERTICAL = 32
    NO_MAG = 64
    UNCORRECTED = 128
    CORRECTED = 256
    CORRECTION_REFUSED = 512
    MAG_DISTURBED = 1024
    NO_REFERENCE = 2048
    GYRO_AIDED = 4096
    REJECTED = 8192
    SENSOR_FAULT = 16384
    ALIASED = 32768
    SLIDING = 65536
    SENSOR_SUSPECT = 131072
    TOOLFACE_UNSETTLED = 262144
    TOOL_ASSUMED = 524288


_WORDS = {bit: (bit.name or "").lower() for bit in Status}


def words(mask: int) -> str:
    """Return the names of the bits that are set, joined by ``|``, such as ``still|corrected``; empty if none is set."""
    return "|".join(word for bit, word in _WORDS.items() if mask & bit)
