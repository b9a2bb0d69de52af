# SPDX-License-Identifier: Apache-2.0
"""Settings of a survey station: north, alignment, sensor errors, acceptance limits, and priors of disturbances."""

from __future__ import annotations

from dataclasses import dataclass, field

from mwd_estimation.assembly.sag import SagCorrection
from mwd_estimation.core.calibrated_range import CalibratedRange
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.survey.posterior.hypotheses import Priors
from mwd_estimation.survey.quality_settings import QualitySettings


@dataclass(frozen=True)
class StationSettings:
    """Settings of the computation of a station."""

    north: str = "best"  #: north of the azimuth; best is grid, else true, else magnetic
    sag: SagCorrection = field(default_factory=SagCorrection)  #: sag of the assembly, added to the inclination
    #: Angles of the hole axis from the tool axis, about y (towards -z) and about z (towards +y), deg.
    hole_axis_deg: tuple[float, float] = (0.0, 0.0)
    toolface_offset_deg: float = 0.0  #: angle from the sensor housing to the scribe line, added to both toolfaces, deg
    errors: SensorErrors = field(default_factory=SensorErrors)  #: sensor errors that remain after calibration
    calibrated: CalibratedRange = field(default_factory=CalibratedRange)  #: temperature range of the calibration
    quality: QualitySettings = field(default_factory=QualitySettings)  #: limits of the verdict
    #: 1 sigma of the axial field of the string, T, if no reference field shows whether the string is magnetised.
    possible_axial: float = 2000.0e-9
    priors: Priors = field(default_factory=Priors)  #: probability of each disturbance before any reading

    def axial_sigma(self, reference: Reference | None) -> float:
        """
        Return 1 sigma of the axial field of the string in an uncorrected azimuth, T.

        Only with a reference field, an unexpected magnetisation of the string can be found; without a reference field,
        sigma must include it.
        """
        compared = reference is not None and reference.has_field
        return self.errors.axial_interference_nt * 1e-9 if compared else self.possible_axial
