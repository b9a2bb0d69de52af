# SPDX-License-Identifier: Apache-2.0
"""
Composition of a survey's azimuth: the sensors and corrections that every interface, export and page states.

The estimator computes every azimuth from one posterior, so the name of the method does not show which sensors
contributed. The sensors are derived from the survey: from the weight of the gyro among its azimuths, and from whether
an axial field of the drill string was estimated.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.survey import Survey

# Smallest share of a sensor in the azimuth, 0 to 1, at which the sensor is named; the same value as in
# `mwd_estimation.survey.decision`.
_NAMED = 0.01
_UNCORRECTED = (AzimuthMethod.RAW, AzimuthMethod.GYRO, AzimuthMethod.GYRO_PROPAGATED, AzimuthMethod.NONE)


@dataclasses.dataclass(frozen=True)
class AzimuthSource:
    """Sensors and corrections that contributed to an azimuth."""

    #: Whether the sensors are known; false if the survey has no azimuth, or an azimuth without a method (imported list,
    #: telemetry link).
    known: bool
    gyro_share: float = 0.0  #: share of the gyro (north seeking) in the information about the azimuth, 0 to 1
    #: Whether the estimated axial field of the string was subtracted from the magnetometer reading.
    without_axial: bool = False
    #: Whether a multi-station analysis corrected the azimuth; None if unknown (the posterior of a run may use one
    #: station or many).
    multi_station: bool | None = None

    @property
    def by_gyro(self) -> bool:
        """Whether a gyro contributed to the azimuth."""
        return self.known and self.gyro_share >= _NAMED

    @property
    def magnetic(self) -> bool:
        """Whether a magnetometer contributed to the azimuth."""
        return self.known and self.gyro_share <= 1.0 - _NAMED

    @property
    def mostly_gyro(self) -> bool:
        """Whether the gyro has the larger share in the azimuth."""
        return self.known and self.gyro_share > 0.5

    @property
    def axial_corrected(self) -> bool:
        """Whether a magnetometer contributed with the axial field of the string subtracted."""
        return self.magnetic and self.without_axial

    @property
    def corrected(self) -> bool:
        """
        Whether the axial field of the string has no effect on the azimuth.

        Either the field was subtracted, or no magnetometer contributed.
        """
        return self.axial_corrected or (self.known and not self.magnetic)

    @property
    def words(self) -> str:
        """Composition of the azimuth as a text for people; empty if the sensors are unknown."""
        if not self.known:
            return ""
        if not self.magnetic:
            return "gyro"
        corrected = "multi-station" if self.multi_station else "corrected" if self.axial_corrected else ""
        field = f"magnetic, {corrected}" if corrected else "magnetic"
        return f"{field}; gyro {100.0 * self.gyro_share:.0f} %" if self.by_gyro else field


def azimuth_source(survey: Survey) -> AzimuthSource:
    """
    Return the composition of a survey's azimuth.

    If the survey has no azimuth, or its method is unknown, `known` is false. In older lists, an azimuth is from a
    single method, and the name of the method shows the sensors.
    """
    method = survey.azimuth_method
    if not survey.has_azimuth or method not in set(AzimuthMethod) - {AzimuthMethod.NONE}:
        return AzimuthSource(known=False)
    weight = sum(one.weight for one in survey.azimuths if one.method == AzimuthMethod.GYRO)
    return AzimuthSource(
        known=True,
        # Without a magnetic field only the gyro contributes, whatever its weight.
        gyro_share=1.0 if method in (AzimuthMethod.GYRO, AzimuthMethod.GYRO_PROPAGATED) else min(max(weight, 0.0), 1.0),
        without_axial=method not in _UNCORRECTED and math.isfinite(survey.sigma_axial_interference),
        multi_station=None if method == AzimuthMethod.FUSED else method == AzimuthMethod.MULTI_STATION,
    )
