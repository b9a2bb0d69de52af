# SPDX-License-Identifier: Apache-2.0
"""S1's field and laboratory case, from raw samples to the fused azimuth of each station."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from mwd_estimation.pipeline.pipeline import Pipeline
from mwd_estimation.settings.estimator import EstimatorSettings
from mwd_estimation.survey.survey import STATIC
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.core.settings import changed
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from mwd_surface.runs.launch_plan import estimator_parameters
from project import SCENARIOS

HEAD = "| case | surveys | accepted | rms deg | mean deg | sigma deg | NEES | within 2 deg | magnetic off by deg |"
_GYRO = "tool.precision.gyro"


@dataclasses.dataclass(frozen=True)
class Case:
    """One case."""

    title: str
    scenario: str
    parameters: dict[str, float | str]  #: parameters of the estimator that differ from the defaults
    unit: dict[str, float]  #: figures of the simulated precision gyro that differ from its grade
    one_position: bool = False  #: whether each station is surveyed in the first of its two positions


CASES = (
    Case("field, .05 deg/sqrt(h), 5 min, g-sensitivity stated", "s1_field", {}, {}),
    Case("field, the same, g-sensitivity not stated", "s1_field", {f"{_GYRO}.g_deg_h_g": 0.5}, {}),
    Case("laboratory, g-sensitivity stated", "s1_lab", {}, {}),
    Case(
        "field, .01 deg/sqrt(h), one position of 2 min, stated",
        "s1_field",
        {
            f"{_GYRO}.bias_deg_h": 0.02,
            f"{_GYRO}.walk_deg_h_sqrt_h": 0.1,
        },
        {
            "noise_deg_sqrt_h": 0.01,
            "bias_deg_h": 0.02,
            "instability_deg_h": 0.005,
            "g_deg_h_g": 0.0,
            "bias_deg_h_per_c": 0.001,
        },
        one_position=True,
    ),
)


def case_row(case: Case, seeds: int) -> str:
    """
    Row of a case: a survey is requested at the end of each station's rest.

    Those that the tool takes by itself meanwhile count, too, the first of all among them. Errors are of the accepted.
    """
    error, sigma, magnetic, taken = [], [], [], 0
    path = SCENARIOS / f"{case.scenario}.yaml"
    for seed in range(1, seeds + 1):
        changes: dict[str, Any] = {"seed": seed}
        if case.unit:
            changes["precision"] = {"grade": "tactical_north", "changes": {"gyro": case.unit}}
        plan = scenario.read(path, changes)
        pipeline = Pipeline(changed(EstimatorSettings(), estimator_parameters(plan) | case.parameters))
        rest, rests = 0, 0
        for block in Sonde(plan).blocks(1.0):
            truth = block["truth"]
            moves = bool(max(np.abs(truth["angular_velocity"]).max(), np.abs(truth["velocity"]).max()) > 1e-3)
            rest = 0 if moves else rest + 1
            rests += rest == 100
            # Two rests of 150 s at a station, half a turn apart.
            if rest == 138 and rests % 2 == (1 if case.one_position else 0):
                pipeline.request_survey(8.0)
            pipeline.push_mag(block["imu/mag"])
            pipeline.push_precision(block["gyro/data_raw"])
            for survey in pipeline.push_imu(block["imu/data_raw"]).surveys:
                if survey.kind != STATIC:
                    continue
                taken += 1
                azimuth = float(truth["azimuth"][-1])
                raw = survey.station.by_method("raw")
                magnetic.append(abs(float(wrap_pi(raw.azimuth - azimuth))) if raw else math.nan)
                if survey.station.verdicts.azimuth == "accept":
                    error.append(float(wrap_pi(survey.station.azimuth - azimuth)))
                    sigma.append(survey.station.sigma_azimuth)
    e, s = np.degrees(error), np.degrees(sigma)
    off = "- | - | - | - | -"
    if len(e):
        off = f"{np.sqrt(np.mean(e**2)):.2f} | {e.mean():+.2f} | {s.mean():.2f} | {np.mean((e / s) ** 2):.2f}"
        off += f" | {100.0 * np.mean(np.abs(e) <= 2.0):.0f} %"
    return f"| {case.title} | {taken} | {len(e)} | {off} | {np.degrees(np.max(magnetic)):.1f} |"
