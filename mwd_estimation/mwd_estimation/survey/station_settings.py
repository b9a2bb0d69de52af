# SPDX-License-Identifier: Apache-2.0
"""Settings of a survey station: north, alignment, sensor errors, acceptance limits, and what may disturb it."""

from __future__ import annotations

from dataclasses import dataclass

from mwd_estimation.assembly.sag import SagCorrection
from mwd_estimation.core.calibrated_range import CalibratedRange
from mwd_estimation.core.error_model import SensorErrors
from mwd_estimation.survey.posterior.hypotheses import Priors
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_sensors.core.settings import setting


@dataclass(frozen=True)
class StationSettings:
    """How a station is computed."""

    north: str = setting(
        "best",
        "North the azimuth refers to; best is grid, else true, else magnetic",
        choices=("best", "grid", "true", "magnetic"),
    )
    sag: SagCorrection = setting(SagCorrection, "Added to the inclination: sag of the assembly")
    hole_axis_deg: tuple[float, float] = setting(
        (0.0, 0.0), "Hole axis against tool axis, about y (towards -z) and z (towards +y)", unit="deg"
    )
    toolface_offset_deg: float = setting(
        0.0, "Added to both toolfaces: sensor housing against scribe line", unit="deg", low=-360.0, high=360.0
    )
    errors: SensorErrors = setting(SensorErrors, "What calibration leaves in the sensors")
    calibrated: CalibratedRange = setting(CalibratedRange, "What the sensors may be off at other temperatures")
    quality: QualitySettings = setting(QualitySettings, "Limits of the verdict")
    priors: Priors = setting(Priors, "How probable each disturbance is before any reading")
