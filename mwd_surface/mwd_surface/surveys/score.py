# SPDX-License-Identifier: Apache-2.0
"""
Comparison of surveys with the truth published by a simulated sonde, printed at the end of `mwd run`.

The comparison is for people only; no estimator reads the truth.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import AzimuthEstimate, Survey, Verdict
from mwd_sensors.core import budgets, wire
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.core.input_files import check_regular
from mwd_surface.bags.bag_reader import Bag, BagError

SURVEY_TYPE = "mwd_msgs/msg/Survey"
_NEAREST = 0.6  # longest time between a survey and the sample of the truth with which the survey is compared, s


@dataclasses.dataclass(frozen=True)
class Scored:
    """One survey and the truth; angles in rad, azimuths from true north, None where unknown."""

    sequence: int
    measured_depth: float  #: true depth of the sonde, m
    #: `inclination`, `azimuth`: true values.
    inclination: float
    azimuth: float
    measured_inclination: float
    sigma_inclination: float
    #: `raw`, `corrected`, `chosen`: azimuth as measured, corrected for axial interference, and as reported by the
    #: survey.
    raw: float | None
    corrected: float | None
    chosen: float | None
    sigma_azimuth: float | None  #: 1 sigma of the reported azimuth
    verdict: Verdict
    action: str  #: main reason to act; empty for an accepted survey

    @property
    def inclination_error(self) -> float:
        """Measured minus true inclination, rad."""
        return self.measured_inclination - self.inclination

    @property
    def azimuth_error(self) -> float | None:
        """Reported minus true azimuth, wrapped to +-pi, rad; None if no azimuth was reported."""
        return None if self.chosen is None else float(wrap_pi(self.chosen - self.azimuth))


def score(bag: Bag, namespace: str = "", truth: Path | None = None) -> list[Scored]:
    """
    Return each survey of a recording with the truth at its time, in order of time.

    namespace: namespace of the well, if the recording has several. truth: file of the truth (parameter `truth_file` of
    the sonde), for a run whose surface received only a link; the surveys are then those of the link. Surveys without
    truth within 0.6 s are left out. The result is empty if the recording has no surveys.

    Raises
    ------
    BagError
        The recording has no truth, or it has several wells and no namespace is given.
    OSError
        The file of the truth cannot be opened or is too large.
    """
    prefix = namespace.strip("/")
    if not any(topic.type_name == SURVEY_TYPE for topic in bag.topics.values()):
        return []
    survey_topic = bag.find_topic(SURVEY_TYPE, f"{prefix}/survey" if truth is None else f"{prefix}/link/survey")
    surveys = _surveys(bag, survey_topic)
    if truth is not None:
        check_regular(truth, budgets.PRESSURE)
        rows = np.loadtxt(truth, delimiter=",", skiprows=1, usecols=(0, 1, 2, 4), ndmin=2)
    else:
        rows = _truth(bag, bag.find_topic(wire.TRUTH.type_name, f"{prefix}/truth"))
    if not len(rows):
        raise BagError(f"{bag.path} has no truth to compare with", "only simulated recordings have")
    scored = []
    for survey in surveys:
        row = rows[int(np.argmin(np.abs(rows[:, 0] - survey.stamp_ns)))]
        if abs(row[0] - survey.stamp_ns) <= _NEAREST * 1e9:
            scored.append(_beside(survey, row))
    return scored


def _surveys(bag: Bag, topic: str) -> list[Survey]:
    # A latched topic can be delivered and recorded more than once.
    found: dict[str, Survey] = {}
    for _, name, _, data in bag.messages([topic]):
        survey = Survey.from_message(bag.decode(name, data))
        found[survey.uuid] = survey
    return sorted(found.values(), key=lambda one: one.stamp_ns)


def _truth(bag: Bag, topic: str) -> NDArray[np.float64]:
    """Return rows of stamp, ns, inclination and azimuth, rad, and measured depth, m; shape (n, 4)."""
    rows = []
    for block in bag.blocks([topic]):
        samples = block[topic][1]
        names = ("stamp_ns", "inclination", "azimuth", "measured_depth")
        rows.append(np.stack([samples[name].astype(float) for name in names], axis=1))
    return np.concatenate(rows) if rows else np.zeros((0, 4))


def _beside(survey: Survey, truth: NDArray[np.float64]) -> Scored:
    _, inclination, azimuth, measured_depth = (float(value) for value in truth)
    by_method = {estimate.method: _from_true_north(survey, estimate) for estimate in survey.azimuths}
    sigma = survey.sigma_azimuth
    return Scored(
        sequence=survey.sequence,
        measured_depth=measured_depth,
        inclination=inclination,
        azimuth=azimuth,
        measured_inclination=survey.inclination,
        sigma_inclination=survey.sigma_inclination,
        raw=by_method.get("raw"),
        corrected=by_method.get("corrected"),
        chosen=survey.azimuth_from(North.TRUE),
        sigma_azimuth=sigma if math.isfinite(sigma) else None,
        verdict=Verdict(survey.verdict),
        action=survey.action,
    )


def _from_true_north(survey: Survey, estimate: AzimuthEstimate) -> float | None:
    if math.isnan(estimate.sigma):
        return None
    return dataclasses.replace(survey, azimuth=estimate.azimuth % math.tau, north=estimate.north).azimuth_from(
        North.TRUE
    )
