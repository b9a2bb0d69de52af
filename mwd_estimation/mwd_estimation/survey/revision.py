# SPDX-License-Identifier: Apache-2.0
"""
What every station of a run says once all the others are known: those below it, and the gyro readings taken since.

The others of a station are taken in from the far ones to the near ones, because the string may be another one from some
station on. No station counts for itself twice, nor does a seek of the gyro: it goes on while the tool is turned in
place, so that what it found in the end holds for every survey taken meanwhile, and is one reading. The run is halved
again and again, so that n stations need some n log2(n) steps.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Sequence

from mwd_estimation.core.verdicts import MOVED
from mwd_estimation.survey.finding import Finding
from mwd_estimation.survey.posterior import hypotheses
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.run_model import RunModel, Taken
from mwd_estimation.survey.station_record import Station
from mwd_estimation.survey.station_settings import StationSettings

# Probability of an external field from which the others of the run speak against a station.
_OUTLIER = 0.5
# A run is divided where the hazard of another string is larger than this, rather than in the middle.
_GAP = 0.1


def findings(
    taken: Sequence[Taken], first: Sequence[Finding | None], settings: StationSettings, newest: int | None = None
) -> list[Finding | None]:
    """
    What is found of each station of a run with all the others of it.

    first: what was found of each when it was taken; readings that came a second time keep that and tell nothing.
    newest: look at so many of the last ones only; the others keep what was found.
    """
    found, begin = dict(enumerate(first)), 0 if newest is None else max(len(taken) - newest, 0)
    repeated = {k for k, one in found.items() if one is not None and one.repeats is not None}
    dated = _with_hazards(with_last_readings(taken), settings)
    new = {k: one for k, one in enumerate(dated) if k not in repeated}
    seeks, model = _seeks(new), RunModel(settings)
    for seek in seeks:
        if max(seek) < begin:
            _learn(model, seek)
    _without_each(model, [seek for seek in seeks if max(seek) >= begin], found)
    return list(found.values())


def with_last_readings(taken: Sequence[Taken]) -> list[Taken]:
    """Stations of a run, each with the last azimuth that its seek of the gyro found."""
    last = {one.gyro.began_ns: one.gyro for one in taken if one.gyro is not None and one.gyro.answers}
    last.pop(None, None)
    return [one if one.gyro is None else one._replace(gyro=last.get(one.gyro.began_ns, one.gyro)) for one in taken]


def _with_hazards(taken: Sequence[Taken], settings: StationSettings) -> list[Taken]:
    """Stations, each with the cumulative hazard of another string, which holds in whatever order they are taken in."""
    hours = [one.hours for one in taken]
    steps = [hypotheses.hazard(settings.priors, now - then) for then, now in itertools.pairwise(hours)]
    return [one._replace(hazard=at) for one, at in zip(taken, itertools.accumulate([0.0, *steps]), strict=False)]


def is_outlier(finding: Finding | None) -> bool:
    """Whether a station probably had another field than the others of its run."""
    return finding is not None and finding.hypotheses.get(Hypothesis.EXTERNAL, 0.0) > _OUTLIER


def is_revised(first: Station, now: Station, least: float = MOVED) -> bool:
    """Whether a station has another verdict than first, or an azimuth that moved by more than `least`, rad."""
    if first.verdict != now.verdict:
        return True
    moved = now.azimuth - first.azimuth
    if not math.isfinite(moved):
        return math.isfinite(now.azimuth) != math.isfinite(first.azimuth)
    return abs(math.remainder(moved, math.tau)) > least


def _seeks(taken: dict[int, Taken]) -> list[dict[int, Taken]]:
    """Stations by seek of the gyro; without one, each by itself."""
    groups: dict[tuple[str, int], dict[int, Taken]] = {}
    for k, one in taken.items():
        began_ns = None if one.gyro is None else one.gyro.began_ns
        groups.setdefault(("station", k) if began_ns is None else ("seek", began_ns), {})[k] = one
    return list(groups.values())


def _learn(model: RunModel, seek: dict[int, Taken]) -> None:
    for one in seek.values():
        model.take(one)


def _without_each(model: RunModel, seeks: list[dict[int, Taken]], found: dict[int, Finding | None]) -> None:
    """Findings of the stations of these seeks, by a model that has learned of every other station."""
    if not seeks:
        return
    if len(seeks) == 1:
        _of_seek(model, seeks[0], found)
        return
    middle = _divided(seeks)
    before, after = seeks[:middle], seeks[middle:]
    for mine, others in ((before, after[::-1]), (after, before)):
        aware = copy.deepcopy(model)
        for seek in others:
            _learn(aware, seek)
        _without_each(aware, mine, found)


def _divided(seeks: list[dict[int, Taken]]) -> int:
    """Where to divide: at the gap nearest to the middle after which the string may well be another, else there."""
    hazards = [next(iter(seek.values())).hazard for seek in seeks]
    gaps = [k for k in range(1, len(seeks)) if hazards[k] - hazards[k - 1] > _GAP]
    return min(gaps, key=lambda k: abs(2 * k - len(seeks)), default=len(seeks) // 2)


def _of_seek(model: RunModel, seek: dict[int, Taken], found: dict[int, Finding | None]) -> None:
    """Findings of the stations of one seek: each with its azimuth, and with the fields of the others."""
    fields = {k: one._replace(gyro=None) for k, one in seek.items()}
    for k, one in seek.items():
        aware = copy.deepcopy(model)
        _learn(aware, {other: field for other, field in fields.items() if other != k})
        found[k] = aware.take(one, learn=False)
