# SPDX-License-Identifier: Apache-2.0
"""
Settings of the estimator.

Each fact is set once: the tool in `tool`, the place in `place`. `derivation` computes the parameters of every filter
from them.
"""

from __future__ import annotations

import dataclasses

from mwd_estimation.downhole.settings import Transmit
from mwd_estimation.gravity import methods as gravity
from mwd_estimation.settings.place import Place
from mwd_estimation.settings.tool import Tool
from mwd_estimation.survey.quality_settings import QualitySettings
from mwd_estimation.survey.survey_settings import SurveySettings
from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_sensors.core.settings import setting


@dataclasses.dataclass(frozen=True)
class VerdictSettings(QualitySettings):
    """Limits for accepting, doubting or rejecting a survey, and probabilities of disturbances before any reading."""

    external_field: float = setting(
        0.05,
        "Probability, before any reading, that steel outside the string disturbs a station. Raise it near other "
        "wells; smaller deviations then make a station doubtful.",
        low=0.0,
        high=0.5,
        expert=True,
    )


@dataclasses.dataclass(frozen=True)
class Gravity:
    """Choice of the method that estimates gravity."""

    method: str = setting(
        gravity.DEFAULT,
        f"Method that estimates gravity; all but {gravity.DEFAULT} are for comparison.  "
        + "; ".join(f"{one.name}: {one.doc}" for one in gravity.METHODS.values())
        + ".",
        choices=tuple(gravity.METHODS),
    )


@dataclasses.dataclass(frozen=True)
class Attitude:
    """Settings of the continuous attitude while drilling."""

    vertical_deg: float = setting(
        3.0,
        "Inclination below which azimuth and high side are not given; they are given again one degree above this "
        "inclination. "
        "Lowering it gives azimuths of little use near the vertical.",
        low=0.5,
        high=20.0,
        expert=True,
    )
    toolface_dwell_s: float = setting(
        5.0,
        "Time without rotation after which a toolface can be used for steering. Raising it delays the first toolface "
        "of a slide; lowering it may release toolfaces of a string that only sticks and will turn again.",
        low=0.0,
        high=120.0,
    )
    toolface_dwell_cycles: float = setting(
        1.5,
        "Like toolface_dwell_s, but as a multiple of the longest stick-slip cycle in the last minutes of rotation; the "
        "longer of the two times applies. Raise it if cycles are irregular.",
        low=1.0,
        high=10.0,
        expert=True,
    )


@dataclasses.dataclass(frozen=True)
class Dynamics:
    """Settings of the summary of drilling dynamics."""

    shock_threshold: float = setting(
        25.0 * STANDARD_GRAVITY,
        "Acceleration, without gravity, that counts as a shock. Raising it counts fewer shocks; use the limit of the "
        "tool's data sheet.",
        unit="m/s^2",
        low=1.0,
        high=1e4,
    )


@dataclasses.dataclass(frozen=True)
class EstimatorSettings:
    """All settings of the estimator."""

    tool: Tool = setting(Tool, "The tool: sensors, calibration and alignment.")
    place: Place = setting(Place, "The place of the well, its magnetic field and gravity.")
    survey: SurveySettings = setting(SurveySettings, "Surveys.")
    verdict: VerdictSettings = setting(VerdictSettings, "Field acceptance criteria of surveys.")
    gravity: Gravity = setting(Gravity, "Gravity extraction.")
    attitude: Attitude = setting(Attitude, "Continuous attitude.")
    dynamics: Dynamics = setting(Dynamics, "Drilling dynamics.")
    transmit: Transmit = setting(Transmit, "Transmission to the surface.")
