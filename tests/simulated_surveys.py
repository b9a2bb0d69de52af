# SPDX-License-Identifier: Apache-2.0
"""Surveys of a simulated sonde beside its truth: the scenario's samples through the estimator, without a recording."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mwd_estimation.pipeline.output import Output
from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.survey import STATIC
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.core.settings import changed
from mwd_sensors.simulator.scenario import Scenario
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.runs.launch_plan import estimator_parameters

_BLOCK_S = 10.0


@dataclasses.dataclass(frozen=True)
class Beside:
    """A survey, its errors of inclination and azimuth, rad, and 1 sigma of both as published; measured depth, m."""

    survey: DecidedSurvey
    inclination_error: float
    sigma_inclination: float
    azimuth_error: float
    sigma_azimuth: float
    measured_depth: float

    @property
    def accepted(self) -> bool:
        """Whether its azimuth may be used."""
        return self.survey.station.verdicts.azimuth == "accept"

    @property
    def accepted_for_inclination(self) -> bool:
        """Whether its inclination may be used."""
        return self.survey.station.verdicts.inclination == "accept"


def surveys(story: Scenario, settings: Mapping[str, Any] | None = None) -> list[Beside]:
    """Static surveys of a scenario, in order, as the live graph takes them; settings: of the estimator, by name."""
    return _played(story, settings)[0]


def revised_surveys(story: Scenario) -> tuple[list[Beside], list[Beside]]:
    """Static surveys of a scenario as they are taken, and as all stations of the run together judge them in the end."""
    return _played(story, None)


def _played(story: Scenario, settings: Mapping[str, Any] | None) -> tuple[list[Beside], list[Beside]]:
    sonde = Sonde(story)
    pipeline = Pipeline(changed(EstimatorSettings(), {**estimator_parameters(story), **(settings or {})}))
    found: list[DecidedSurvey] = []
    truth = []

    def keep(output: Output) -> None:
        found.extend(output.surveys)

    for block in sonde.blocks(_BLOCK_S):
        truth.append(block["truth"])
        pipeline.push_mag(block["imu/mag"])
        if "gyro/data_raw" in block:
            pipeline.push_precision(block["gyro/data_raw"])
        keep(pipeline.push_imu(block["imu/data_raw"]))
    keep(pipeline.finish())
    rows, first = np.concatenate(truth), [survey for survey in found if survey.kind == STATIC]
    now = pipeline.revisions()
    last = [now.get(survey.sequence, survey) for survey in first]
    one, other = ([_beside(survey, rows, sonde.reference.convergence) for survey in every] for every in (first, last))
    return one, other


def _beside(survey: DecidedSurvey, truth: np.ndarray, convergence: float) -> Beside:
    row, station = truth[np.argmin(np.abs(truth["stamp_ns"] - survey.stamp_ns))], survey.station
    from_true = convergence if station.north == "grid" else 0.0
    return Beside(
        survey,
        station.inclination - float(row["inclination"]),
        math.sqrt(station.covariance[0, 0]),
        float(wrap_pi(station.azimuth + from_true - float(row["azimuth"]))),
        math.sqrt(station.covariance[1, 1]),
        float(row["measured_depth"]),
    )
