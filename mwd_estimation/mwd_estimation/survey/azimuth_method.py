# SPDX-License-Identifier: Apache-2.0
"""Methods that determine the azimuth of a station; a value is the name in messages, tables and settings."""

from __future__ import annotations

from enum import StrEnum, unique


@unique
class AzimuthMethod(StrEnum):
    """
    Method that determined an azimuth.

    RAW and SINGLE_STATION use one magnetic station; RAW is uncorrected, SINGLE_STATION corrected for axial interference
    (short-collar method). MULTI_STATION corrects a station by the stations of its run. GYRO is a north seek at the
    station, GYRO_PROPAGATED the azimuth of the last station propagated by the gyros. FUSED is the posterior of all
    measurements, even of a single magnetometer; the weights of the azimuths show which methods contributed. NONE: there
    is no azimuth.
    """

    RAW = "raw"
    SINGLE_STATION = "corrected"
    MULTI_STATION = "msa"
    GYRO = "gyro"
    GYRO_PROPAGATED = "carried"
    FUSED = "fused"
    NONE = "none"
