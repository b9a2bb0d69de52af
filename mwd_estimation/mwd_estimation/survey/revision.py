# SPDX-License-Identifier: Apache-2.0
"""
What every station of a run says once all the others are known: those below it, and the gyro readings taken since.

No station counts for itself twice. The others of each station are taken in by halves, so that n stations need some
n log2(n) steps.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import NamedTuple

from mwd_estimation.gyrocompass.solution import Solution
from mwd_estimation.survey.finding import Finding
from mwd_estimation.survey.measurement import Measured
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.run_model import RunModel
from mwd_estimation.survey.station_record import Station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.turning_string import Turning

# Probability of an external field from which the others of the run speak against a station.
_OUTLIER = 0.5
# An azimuth that moves by less, rad, is no revision worth a word.
_MOVED = math.radians(0.05)


class Taken(NamedTuple):
    """
    A station as a run takes it in.

    Readings, when, h from anywhere (nan: not known), north by a gyro, and what the string showed while it turned.
    """

    measured: Measured
    hours: float = math.nan
    gyro: Solution | None = None
    turning: Turning | None = None


def findings(
    taken: Sequence[Taken], first: Sequence[Finding | None], settings: StationSettings, newest: int | None = None
) -> list[Finding | None]:
    """
    What is found of each station of a run with all the others of it.

    first: what was found of each when it was taken; readings that came a second time keep that and tell nothing.
    newest: look at so many of the last ones only; the others keep what was found.
    """
    found = dict(enumerate(first))
    new = [k for k, one in found.items() if one is None or one.repeats is None]
    model, begin = RunModel(settings), 0 if newest is None else max(len(taken) - newest, 0)
    for k in new:
        if k < begin:
            model.take(*taken[k])
    _without_each(model, [k for k in new if k >= begin], taken, found)
    return list(found.values())


def is_outlier(finding: Finding | None) -> bool:
    """Whether a station probably had another field than the others of its run."""
    return finding is not None and finding.hypotheses.get(Hypothesis.EXTERNAL, 0.0) > _OUTLIER


def is_revised(first: Station, now: Station, least: float = _MOVED) -> bool:
    """Whether a station has another verdict than first, or an azimuth that moved by more than `least`, rad."""
    if first.verdict != now.verdict:
        return True
    moved = now.azimuth - first.azimuth
    if not math.isfinite(moved):
        return math.isfinite(now.azimuth) != math.isfinite(first.azimuth)
    return abs(math.remainder(moved, math.tau)) > least


def _without_each(model: RunModel, at: list[int], taken: Sequence[Taken], found: dict[int, Finding | None]) -> None:
    """Findings of stations `at`, by a model that has learned of every station but these."""
    if not at:
        return
    if len(at) == 1:
        found[at[0]] = model.take(*taken[at[0]], learn=False)
        return
    half = len(at) // 2
    for mine, others in ((at[:half], at[half:]), (at[half:], at[:half])):
        aware = copy.deepcopy(model)
        for k in others:
            aware.take(*taken[k])
        _without_each(aware, mine, taken, found)
