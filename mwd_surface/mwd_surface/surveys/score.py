# SPDX-License-Identifier: Apache-2.0
"""Judgement of a run: its surveys against the truth of a simulation, and the surveys that its links did not receive."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_estimation.core.north import North
from mwd_estimation.survey.survey import AzimuthEstimate, Survey, Verdict
from mwd_sensors.core import budgets, wire
from mwd_sensors.core.frames import wrap_pi
from mwd_sensors.core.input_files import check_regular
from mwd_sensors.core.message_record import stamp_of
from mwd_sensors.telemetry import meanings
from mwd_surface.bags.bag_reader import Bag, BagError

# Comparison with the truth published by a simulated sonde, printed at the end of `mwd run`. The comparison is for
# people only; no estimator reads the truth.

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


def score(bags: Sequence[Bag], truth: Path | None = None) -> list[Scored]:
    """
    Return each survey in the recordings of a run with the truth at its time, in order of time.

    A run has several recordings if its surface was started again. truth: file of the truth (parameter `truth_file` of
    the sonde), for a run whose surface received only a link; the surveys are then those of the link. Surveys without
    truth within 0.6 s are left out. The result is empty if the recordings have no surveys.

    Raises
    ------
    BagError
        No recording has truth, or one has several wells.
    OSError
        The file of the truth cannot be opened or is too large.
    """
    surveys: dict[str, Survey] = {}
    for bag in _with(bags, SURVEY_TYPE):
        surveys |= _surveys(bag, bag.find_topic(SURVEY_TYPE, "/survey" if truth is None else "/link/survey"))
    if not surveys:
        return []
    if truth is not None:
        check_regular(truth, budgets.PRESSURE)
        rows = np.loadtxt(truth, delimiter=",", skiprows=1, usecols=(0, 1, 2, 4), ndmin=2)
    else:
        of_truth = _with(bags, wire.TRUTH.type_name)
        parts = [_truth(bag, bag.find_topic(wire.TRUTH.type_name, "/truth")) for bag in of_truth]
        rows = np.concatenate(parts) if parts else np.zeros((0, 4))
    if not len(rows):
        raise BagError(f"{bags[-1].path} has no truth to compare with", "only simulated recordings have")
    scored = []
    for survey in sorted(surveys.values(), key=lambda one: one.stamp_ns):
        row = rows[int(np.argmin(np.abs(rows[:, 0] - survey.stamp_ns)))]
        if abs(row[0] - survey.stamp_ns) <= _NEAREST * 1e9:
            scored.append(_beside(survey, row))
    return scored


def _with(bags: Sequence[Bag], type_name: str) -> list[Bag]:
    """Return the recordings that have a topic of a type; one that began after the end of a simulation has no truth."""
    return [bag for bag in bags if any(topic.type_name == type_name for topic in bag.topics.values())]


def _surveys(bag: Bag, topic: str) -> dict[str, Survey]:
    """Return the surveys of a topic by uuid; a latched topic can be delivered and recorded more than once."""
    found: dict[str, Survey] = {}
    for _, name, _, data in bag.messages([topic]):
        survey = Survey.from_message(bag.decode(name, data))
        found[survey.uuid] = survey
    return found


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


# Intervals with flow for which a link received no complete survey.

_WORD, _QUALITY, _SURVEY = "mwd_msgs/msg/LinkWord", "mwd_msgs/msg/LinkQuality", "mwd_msgs/msg/Survey"
# Constants of LinkWord (kind, status, revision) and of LinkQuality (state).
_OF_SURVEY, _ERASED, _FINAL = 2, 1, 1
_NO_INPUT, _NO_FLOW = 0, 1


class Unlisted(NamedTuple):
    """
    Interval with flow whose survey was not received completely: begin and end, ns, and the reason.

    A tool sends a survey at the beginning of each interval with flow.
    """

    start_ns: int
    end_ns: int
    reason: str


@dataclasses.dataclass
class _Flow:
    """Interval with flow at one link: end of the previous flow, begin, end, ns; the link's reasons for missing data."""

    before_ns: int
    start_ns: int
    end_ns: int
    reasons: list[str]


def unlisted(bag: Bag) -> list[Unlisted]:
    """
    Return the intervals with flow for which a link received no complete survey, each with a reason.

    Intervals for which the link gave no reason are left out. A wired tool also sends without flow, so its lost surveys
    cannot be found.
    """
    if not all(any(topic.type_name == kind for topic in bag.topics.values()) for kind in (_WORD, _QUALITY)):
        return []
    listed = []
    if any(topic.type_name == _SURVEY for topic in bag.topics.values()):
        surveys = bag.find_topic(_SURVEY, "/link/survey")
        listed = [stamp_of(bag.decode(name, data).header.stamp) for _, name, _, data in bag.messages([surveys])]
    erased = _erased(bag, bag.find_topic(_WORD, "/link/word"))
    found: dict[int, Unlisted] = {}
    for flow in _flows(bag, bag.find_topic(_QUALITY, "/link/quality")):
        if any(flow.before_ns <= stamp <= flow.end_ns for stamp in listed):
            continue
        reason = next((text for at, text in erased if flow.start_ns <= at <= flow.end_ns), "")
        reason = reason or next(iter(flow.reasons[-1:]), "")
        if reason:
            found.setdefault(flow.start_ns, Unlisted(flow.start_ns, flow.end_ns, reason))
    return list(found.values())


def _erased(bag: Bag, topic: str) -> list[tuple[int, str]]:
    """Return the times, ns, of survey inclinations that were dropped as too uncertain, each with a sentence."""
    out = []
    for _, name, _, data in bag.messages([topic]):
        word = bag.decode(name, data)
        if (word.kind, word.status, word.revision) != (_OF_SURVEY, _ERASED, _FINAL):
            continue
        if meanings.meaning_of(word.name) == meanings.INCLINATION:
            out.append(
                (stamp_of(word.start), f"the inclination was not received clearly, confidence {word.confidence:.2f}")
            )
    return out


def _flows(bag: Bag, topic: str) -> list[_Flow]:
    """Return the intervals with flow of all links; flow before the first report without flow of a link is left out."""
    flows: list[_Flow] = []
    now: dict[str, _Flow | None] = {}
    stopped: dict[str, int] = {}
    for _, name, _, data in bag.messages([topic]):
        quality = bag.decode(name, data)
        stamp, link = stamp_of(quality.header.stamp), quality.link
        if quality.state == _NO_INPUT:
            continue
        if quality.state == _NO_FLOW:
            if now.get(link) is not None or link not in stopped:
                stopped[link] = stamp
            now[link] = None
        elif link in stopped:
            flow = now.get(link)
            if flow is None:
                flow = _Flow(stopped[link], stamp, stamp, [])
                now[link] = flow
                flows.append(flow)
            flow.end_ns = stamp
            flow.reasons += [quality.reason] if quality.reason else []
    return flows
