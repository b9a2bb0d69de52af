# SPDX-License-Identifier: Apache-2.0
"""
Revise every station of a run with all other stations, including later ones and later gyro azimuths.

A model of the run learns the stations from the first to the last, another one from the last to the first. At each
station, the two are combined: what they know of the errors that all stations share, without this station. Each reading
is used once. A north seek counts as one reading for all its surveys: the seek continues while the tool is turned in
place, so its last result is valid for all of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

from mwd_estimation.core.verdicts import MOVED
from mwd_estimation.survey.finding import Finding
from mwd_estimation.survey.posterior import hypotheses
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.run_model import RunModel, Taken, elapsed
from mwd_estimation.survey.station_record import Station
from mwd_estimation.survey.station_settings import StationSettings

# A station with a larger probability of an external field is an outlier of its run.
_OUTLIER = 0.5
# Number of models kept in memory at a time, one before each seek: with a gyro, about 50 MB.
_BLOCK = 320


def findings(
    taken: Sequence[Taken],
    settings: StationSettings,
    first: Sequence[Finding | None] | None = None,
    newest: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[list[Finding | None], list[Finding | None]]:
    """
    Return two findings of each station of a run: from the stations before it, and from all other stations.

    Stations with repeated readings keep their first finding, and are not used for other stations.

    first: findings of the first kind; None: compute them here, which is possible only for a run without a gyro.
    newest: number of last stations to compute again (with their whole seek); the others keep their first finding. None:
    all stations.
    progress: called several times with the number of stations newly done; a station counts half when it is decided here
    for the first time, and half when it is decided with all others.
    """
    known = dict(enumerate(first or ()))
    begin = 0 if newest is None else max(len(taken) - newest, 0)
    progress = progress or (lambda _done: None)
    dated = _in_any_order(with_last_readings(taken), settings)
    seeks = _seeks({k: one for k, one in enumerate(dated) if not _is_repeated(known.get(k))})

    def learn(model: RunModel, seek: dict[int, Taken]) -> None:
        for k, one in seek.items():
            if k in known:
                model.learn(one)
            else:
                known[k] = model.take(one)
                progress(0.5)

    # Keep the state of the model before each station for one block of stations at a time, because it needs much memory.
    model, starts = RunModel(settings), [RunModel(settings)]
    for k, seek in enumerate(seeks[: (len(seeks) - 1) // _BLOCK * _BLOCK], 1):
        learn(model, seek)
        if k % _BLOCK == 0:
            starts.append(model.copy())
    found, later = dict[int, Finding | None](), RunModel(settings)
    turning = next((one.turning for one in reversed(dated) if one.turning is not None), None)
    for block in reversed(range(len(starts))):
        model, before = starts[block], list[tuple[dict[int, Taken], RunModel]]()
        for seek in seeks[block * _BLOCK : (block + 1) * _BLOCK]:
            if max(seek) >= begin:
                before.append((seek, model.at(next(iter(seek.values())), turning)))
            learn(model, seek)
        for seek, model in reversed(before):
            if any(_is_repeated(known[k]) for k in seek):
                continue
            found |= _of_seek(model.between(later, next(iter(seek.values()))), seek)
            # The result of the turning string is already in the models of the earlier stations: do not count it again.
            for one in seek.values():
                later.learn(one._replace(turning=None))
            progress(0.5 * len(seek))
    was = [known[k] for k in range(len(taken))]
    return was, [found.get(k, one) for k, one in enumerate(was)]


def _is_repeated(finding: Finding | None) -> bool:
    return finding is not None and finding.repeats is not None


def with_last_readings(taken: Sequence[Taken]) -> list[Taken]:
    """Return the stations of a run, each with the last azimuth that its seek of the gyro found."""
    last = {one.gyro.began_ns: one.gyro for one in taken if one.gyro is not None and one.gyro.answers}
    last.pop(None, None)
    return [one if one.gyro is None else one._replace(gyro=last.get(one.gyro.began_ns, one.gyro)) for one in taken]


def _in_any_order(taken: Sequence[Taken], settings: StationSettings) -> list[Taken]:
    """
    Return the stations with the cumulative hazard of string changes and the gyro age filled in.

    A model can then process the stations in any order.
    """
    hours = [one.hours for one in taken]
    steps = [hypotheses.hazard(settings.priors, now - then) for then, now in itertools.pairwise(hours)]
    hazards = list(itertools.accumulate([0.0, *steps]))[: len(taken)]
    # All surveys of one seek have the time of its first survey.
    seeks = [None if one.gyro is None else one.gyro.began_ns for one in taken]
    times, last = [0.0] * min(len(taken), 1), 0
    for k in range(1, len(taken)):
        if seeks[k] is None or seeks[k] != seeks[last]:
            times.append(times[last] + elapsed(hours[last], hours[k]))
            last = k
        else:
            times.append(times[last])
    first = next((at for one, at in zip(taken, times, strict=True) if one.gyro is not None and one.gyro.answers), 0.0)
    ages = [max(at - first, 0.0) for at in times]
    return [one._replace(hazard=hazard, age=age) for one, hazard, age in zip(taken, hazards, ages, strict=True)]


def is_outlier(finding: Finding | None) -> bool:
    """Return whether a station probably had an external field, unlike its run; False if `finding` is None."""
    return finding is not None and finding.hypotheses.get(Hypothesis.EXTERNAL, 0.0) > _OUTLIER


def is_revised(first: Station, now: Station, least: float = MOVED) -> bool:
    """
    Return whether the verdict of a station differs from the first one, or its azimuth by more than `least`, rad.

    The azimuths also differ if only one of them is known.
    """
    if first.verdict != now.verdict:
        return True
    moved = now.azimuth - first.azimuth
    if not math.isfinite(moved):
        return math.isfinite(now.azimuth) != math.isfinite(first.azimuth)
    return abs(math.remainder(moved, math.tau)) > least


def _seeks(taken: dict[int, Taken]) -> list[dict[int, Taken]]:
    """Return the stations grouped by seek of the gyro; a station without a seek is a group by itself."""
    groups: dict[tuple[str, int], dict[int, Taken]] = {}
    for k, one in taken.items():
        began_ns = None if one.gyro is None else one.gyro.began_ns
        groups.setdefault(("station", k) if began_ns is None else ("seek", began_ns), {})[k] = one
    return list(groups.values())


def _of_seek(model: RunModel, seek: dict[int, Taken]) -> dict[int, Finding | None]:
    """
    Return the finding of each station of one seek, by index of the station; None where no sensor measures the azimuth.

    model: run model that has learned the stations outside the seek. In addition, each finding uses the accelerometers
    and magnetometers of the other stations of the seek, but not their gyro azimuths.
    """
    if len(seek) > 1:
        model.merge()
    fields = {k: one._replace(gyro=None) for k, one in seek.items()}
    found = {}
    for k, one in seek.items():
        aware = model.copy()
        for other, field in fields.items():
            if other != k:
                aware.learn(field)
        found[k] = aware.take(one, learn=False)
    return found
