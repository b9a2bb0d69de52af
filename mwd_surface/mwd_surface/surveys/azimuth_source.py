# SPDX-License-Identifier: Apache-2.0
"""
Composition of a survey's azimuth, as every interface, export and page states it.

The estimator determines every azimuth by one posterior, so the name of the method does not show which sensors
contributed. They follow from the survey: the weight of the gyro among its azimuths, and whether an axial field of the
string was estimated.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.survey import Survey

# A sensor whose share in the azimuth is smaller than this is not named; the estimator ignores a gyro with such a share.
_NAMED = 0.01
_UNCORRECTED = (AzimuthMethod.RAW, AzimuthMethod.GYRO, AzimuthMethod.GYRO_PROPAGATED, AzimuthMethod.NONE)


@dataclasses.dataclass(frozen=True)
class AzimuthSource:
    """
    Sensors and corrections that contributed to an azimuth.

    Attributes
    ----------
    known : bool
        False if there is no azimuth, or if only the angle is known (imported list, telemetry link).
    gyro_share : float
        Share of the north seek in the information about the azimuth, 0 to 1.
    without_axial : bool
        Whether the estimated axial field of the string was subtracted from the magnetometer reading.
    multi_station : bool or None
        Whether a multi-station analysis corrected the azimuth; None if unknown (the posterior of a run may use one
        station or many).
    """

    known: bool
    gyro_share: float = 0.0
    without_axial: bool = False
    multi_station: bool | None = None

    @property
    def by_gyro(self) -> bool:
        """Whether a gyro contributed."""
        return self.known and self.gyro_share >= _NAMED

    @property
    def magnetic(self) -> bool:
        """Whether a magnetometer contributed."""
        return self.known and self.gyro_share <= 1.0 - _NAMED

    @property
    def mostly_gyro(self) -> bool:
        """Whether the gyro has the larger share."""
        return self.known and self.gyro_share > 0.5

    @property
    def axial_corrected(self) -> bool:
        """Whether a magnetometer contributed with the axial field of the string subtracted."""
        return self.magnetic and self.without_axial

    @property
    def corrected(self) -> bool:
        """Whether the axial field of the string has no effect: it was subtracted, or no magnetometer contributed."""
        return self.axial_corrected or (self.known and not self.magnetic)

    @property
    def words(self) -> str:
        """Description for people; empty if unknown."""
        if not self.known:
            return ""
        if not self.magnetic:
            return "gyro"
        corrected = "multi-station" if self.multi_station else "corrected" if self.axial_corrected else ""
        field = f"magnetic, {corrected}" if corrected else "magnetic"
        return f"{field}; gyro {100.0 * self.gyro_share:.0f} %" if self.by_gyro else field


def azimuth_source(survey: Survey) -> AzimuthSource:
    """Return the composition of a survey's azimuth; in older lists it is derived from the name of the method."""
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
