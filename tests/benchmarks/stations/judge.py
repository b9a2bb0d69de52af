# SPDX-License-Identifier: Apache-2.0
"""Readings through the survey decision, and what the decision is worth: one line of a table for a kind of station."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.attitude.gyro_azimuth_filter import PropagatedAzimuth
from mwd_estimation.core.reference_field import Reference
from mwd_estimation.core.time_bins import Average
from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey.decided_survey import DecidedSurvey
from mwd_estimation.survey.decision import SurveyDecision
from mwd_estimation.survey.fault_history import FaultHistory
from mwd_estimation.survey.static_survey import StillAverage
from mwd_estimation.survey.station_settings import StationSettings
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import wrap_pi
from stations.tool_code import DEG, FIELD_NOISE, FORCE_NOISE

HEAD = (
    "| stations | number | accepted % | not determined % | > 3 sigma % | > 10 deg % | > 45 deg % | rms deg "
    "| NEES | NEES, all | inclination > 3 sigma % | of > 3 sigma: put right by a revision |"
)
UNKNOWN = PropagatedAzimuth(*[math.nan] * 5)
_SECOND, _AVERAGED, _SAMPLES = 10**9, 10 * 10**9, 1000


@dataclasses.dataclass(frozen=True)
class Judged:
    """Errors and 1 sigma, rad, of one station as published, and whether azimuth and inclination are accepted."""

    error: float
    sigma: float
    accepted: bool
    #: Whether the attitude does not determine the azimuth, and the station is accepted for its inclination.
    undetermined: bool
    inclination_error: float
    inclination_sigma: float
    inclination_accepted: bool
    #: Whether the estimator, after the run, proposed a revision in which nothing beyond 3 sigma is accepted.
    put_right: bool = False

    @property
    def leans(self) -> bool:
        """Whether the inclination is beyond 3 sigma, and was accepted."""
        return self.inclination_accepted and abs(self.inclination_error) > 3.0 * self.inclination_sigma

    @property
    def wrong(self) -> bool:
        """Whether azimuth or inclination is beyond 3 sigma, and was accepted."""
        return self.leans or (self.accepted and abs(self.error) > 3.0 * self.sigma)


def new_decision(settings: StationSettings | None = None) -> SurveyDecision:
    """The decision of a run with settings as they come."""
    return SurveyDecision(settings or StationSettings(), FaultHistory())


def still(f_t: Array, b_t: Array, second: int) -> StillAverage:
    """Average of readings at rest, m/s^2 and T, shape (3,), that began in this second of the run."""
    imu = Average(np.concatenate([np.zeros(3), f_t]), np.diag([1e-12] * 3 + [FORCE_NOISE**2] * 3), _SAMPLES)
    mag = Average(b_t, FIELD_NOISE**2 * np.eye(3), _SAMPLES)
    start = (1 + second) * _SECOND
    return StillAverage(start, start + _AVERAGED, imu, mag, None, None, requested=False)


def judged(survey: DecidedSurvey, inclination: float, azimuth: float) -> Judged:
    """A survey against the hole's attitude, rad; a sigma of pi and no error where it has no azimuth."""
    station = survey.station
    known = math.isfinite(station.azimuth)
    return Judged(
        error=float(wrap_pi(station.azimuth - azimuth)) if known else math.nan,
        sigma=math.sqrt(station.covariance[1, 1]) if known else math.pi,
        accepted=known and station.verdicts.azimuth == "accept",
        undetermined=station.verdicts.azimuth == "not_determined" and station.verdict == "accept",
        inclination_error=station.inclination - inclination,
        inclination_sigma=math.sqrt(station.covariance[0, 0]),
        inclination_accepted=station.verdicts.inclination == "accept",
    )


def decide(
    decision: SurveyDecision,
    average: StillAverage,
    reference: Reference,
    gyro: Solution | None = None,
    propagated: PropagatedAzimuth = UNKNOWN,
) -> DecidedSurvey:
    """One station through begin and complete."""
    return decision.complete(decision.begin(average, 1, reference, gyro), propagated)


def row(name: str, found: list[Judged]) -> str:
    """Markdown row under `HEAD`; shares of > 3 sigma, > 10 and > 45 deg are of what was accepted."""
    leaning = [one.leans for one in found if one.inclination_accepted]
    error, sigma = np.array([one.error for one in found]), np.array([one.sigma for one in found])
    known, accepted = np.isfinite(error), np.array([one.accepted for one in found], dtype=bool)
    off, limit = np.abs(error[accepted]), sigma[accepted]

    def share(beyond: np.ndarray) -> str:
        return f"{100.0 * np.mean(beyond):.2f}" if len(beyond) else ""

    def mean(values: Array) -> str:
        return f"{np.mean(values):.2f}" if len(values) else ""

    words = [f"{len(found)}", f"{100.0 * np.mean(accepted):.1f}"]
    words += [f"{100.0 * np.mean([one.undetermined for one in found]):.1f}"]
    words += [share(off > 3.0 * limit), share(off > 10.0 * DEG)]
    words += [share(off > 45.0 * DEG), f"{math.sqrt(np.mean(off**2)) / DEG:.2f}" if len(off) else ""]
    words += [mean((off / limit) ** 2), mean((error[known] / sigma[known]) ** 2), share(np.array(leaning))]
    wrong = [one.put_right for one in found if one.wrong]
    words += [f"{sum(wrong)} of {len(wrong)}" if wrong else ""]
    return f"| {name} | " + " | ".join(words) + " |"
