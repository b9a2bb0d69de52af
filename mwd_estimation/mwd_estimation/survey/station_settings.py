# SPDX-License-Identifier: Apache-2.0
"""Settings of a survey station: north, alignment, sensor errors, acceptance limits, and what may disturb it."""

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

    north: str = "best"  #: north that the azimuth refers to; best is grid, else true, else magnetic
    sag: SagCorrection = field(default_factory=SagCorrection)  #: added to the inclination: sag of the assembly
    hole_axis_deg: tuple[float, float] = (0.0, 0.0)  #: hole axis against tool axis, about y (towards -z) and z (to +y)
    toolface_offset_deg: float = 0.0  #: added to both toolfaces: sensor housing against scribe line
    errors: SensorErrors = field(default_factory=SensorErrors)  #: what calibration leaves in the sensors
    calibrated: CalibratedRange = field(default_factory=CalibratedRange)  #: of the sensors, by temperature
    quality: QualitySettings = field(default_factory=QualitySettings)  #: limits of the verdict
    #: Axial field of the string, 1 sigma, T, where no reference field shows whether the string is magnetised.
    possible_axial: float = 2000.0e-9
    priors: Priors = field(default_factory=Priors)  #: how probable each disturbance is before any reading

    def axial_sigma(self, reference: Reference | None) -> float:
        """
        Return 1 sigma of the axial field of the string in an azimuth that is not corrected for it, T.

        Only a reference field shows whether the string is magnetised beyond what its collars let expect; without one
        the azimuth has to allow for it.
        """
        compared = reference is not None and reference.has_field
        return self.errors.axial_interference_nt * 1e-9 if compared else self.possible_axial
