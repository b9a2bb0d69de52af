# SPDX-License-Identifier: Apache-2.0
"""
What the azimuth of a survey is made of, as every interface, export and page states it.

The estimator decides every azimuth by one posterior, so the name of the method says little. What took part is read
from the survey: the weight of the gyro among its azimuths, and whether a field along the axis was estimated.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_surface.surveys.survey_record import Survey

# A sensor with a smaller share in the azimuth is not named; the estimator does not let such a gyro count either.
_NAMED = 0.01
_UNCORRECTED = (AzimuthMethod.RAW, AzimuthMethod.GYRO, AzimuthMethod.GYRO_PROPAGATED, AzimuthMethod.NONE)


@dataclasses.dataclass(frozen=True)
class AzimuthSource:
    """
    Sensors and corrections behind an azimuth.

    Attributes
    ----------
    known : bool
        False without an azimuth, and where only the angle came: an imported list, a telemetry link.
    gyro_share : float
        Share of the north seek in what is known of the azimuth, 0 to 1.
    without_axial : bool
        The magnetometer is read without the estimated field of the string along the axis.
    multi_station : bool or None
        Corrected by a multi-station analysis; None where the survey does not tell (a posterior of a run may rest on
        one station or on many).
    """

    known: bool
    gyro_share: float = 0.0
    without_axial: bool = False
    multi_station: bool | None = None

    @property
    def by_gyro(self) -> bool:
        """A gyro took part."""
        return self.known and self.gyro_share >= _NAMED

    @property
    def magnetic(self) -> bool:
        """A magnetometer took part."""
        return self.known and self.gyro_share <= 1.0 - _NAMED

    @property
    def mostly_gyro(self) -> bool:
        """The gyro has the larger share."""
        return self.known and self.gyro_share > 0.5

    @property
    def axial_corrected(self) -> bool:
        """A magnetometer took part, and the field of the string along the axis is taken off."""
        return self.magnetic and self.without_axial

    @property
    def corrected(self) -> bool:
        """The string's axial field does not turn it: taken off, or no magnetometer took part."""
        return self.axial_corrected or (self.known and not self.magnetic)

    @property
    def words(self) -> str:
        """For people; empty where it is not known."""
        if not self.known:
            return ""
        if not self.magnetic:
            return "gyro"
        corrected = "multi-station" if self.multi_station else "corrected" if self.axial_corrected else ""
        field = f"magnetic, {corrected}" if corrected else "magnetic"
        return f"{field}; gyro {100.0 * self.gyro_share:.0f} %" if self.by_gyro else field


def azimuth_source(survey: Survey) -> AzimuthSource:
    """What the azimuth of a survey is made of; of older lists it follows from the name of the method."""
    method = survey.azimuth_method
    if not survey.has_azimuth or method not in set(AzimuthMethod) - {AzimuthMethod.NONE}:
        return AzimuthSource(known=False)
    weight = sum(one.weight for one in survey.azimuths if one.method == AzimuthMethod.GYRO)
    return AzimuthSource(
        known=True,
        # Without a field the gyro stands alone, whatever its weight.
        gyro_share=1.0 if method in (AzimuthMethod.GYRO, AzimuthMethod.GYRO_PROPAGATED) else min(max(weight, 0.0), 1.0),
        without_axial=method not in _UNCORRECTED and math.isfinite(survey.sigma_axial_interference),
        multi_station=None if method == AzimuthMethod.FUSED else method == AzimuthMethod.MULTI_STATION,
    )
