# SPDX-License-Identifier: Apache-2.0
"""Methods by which a station's azimuth is found; a value is the method's name in messages, tables and settings."""

from __future__ import annotations

from enum import StrEnum, unique


@unique
class AzimuthMethod(StrEnum):
    """
    Method that determined an azimuth.

    RAW and SINGLE_STATION read one magnetic station (single-station, or short-collar, correction of the axial
    interference); MULTI_STATION corrects it by the stations of its run; GYRO is a north seek at the station,
    GYRO_PROPAGATED the last station's azimuth turned on by the gyros. FUSED is the posterior of all that was measured,
    even of one magnetometer alone: what took part says the weight of each azimuth. NONE means that there is none.
    """

    RAW = "raw"
    SINGLE_STATION = "corrected"
    MULTI_STATION = "msa"
    GYRO = "gyro"
    GYRO_PROPAGATED = "carried"
    FUSED = "fused"
    NONE = "none"
