# SPDX-License-Identifier: Apache-2.0
"""
Revise every station of a run with all other stations, including later ones and later gyro azimuths.

For each station, the run model is updated with the other stations in order from far to near, because the string may
have changed at some station. Each reading is used once. A north seek counts as one reading for all its surveys: the
seek continues while the tool is turned in place, so its last result is valid for all of them. The run is divided in
halves recursively, so that n stations need about n log2(n) steps.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import threading
from collections.abc import Callable, Sequence
from concurrent import futures

from mwd_estimation.core.verdicts import MOVED
from mwd_estimation.survey.finding import Finding
from mwd_estimation.survey.posterior import hypotheses
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.run_model import RunModel, Taken, elapsed
from mwd_estimation.survey.station_record import Station
from mwd_estimation.survey.station_settings import StationSettings

# A station with a larger probability of an external field is an outlier of its run.
_OUTLIER = 0.5
# A run is divided between two stations if the hazard of a change of the string between them is above this; without such
# a pair, the run is divided in the middle.
_GAP = 0.1


def findings(
    taken: Sequence[Taken],
    first: Sequence[Finding | None],
    settings: StationSettings,
    newest: int | None = None,
    progress: Callable[[int], None] | None = None,
    threads: int = 1,
) -> list[Finding | None]:
    """
    Return the finding of each station of a run, computed with all other stations of the run.

    first: finding of each station when it was taken. Stations with repeated readings keep this finding, and are not
    used for other stations.
    newest: number of the last stations to compute again; the stations before keep their finding. None: all stations.
    progress: called after each seek with its number of stations, from any thread, one call at a time.
    threads: number of threads, without influence on the result.
    """
    found, begin = dict(enumerate(first)), 0 if newest is None else max(len(taken) - newest, 0)
    repeated = {k for k, one in found.items() if one is not None and one.repeats is not None}
    dated = _in_any_order(with_last_readings(taken), settings)
    new = {k: one for k, one in enumerate(dated) if k not in repeated}
    seeks, model = _seeks(new), RunModel(settings)
    for seek in seeks:
        if max(seek) < begin:
            _learn(model, seek)
    work = _Work(found, progress or (lambda _done: None), threading.Lock())
    _without_each(model, [seek for seek in seeks if max(seek) >= begin], work, threads)
    return list(found.values())


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


def _learn(model: RunModel, seek: dict[int, Taken]) -> None:
    for one in seek.values():
        model.learn(one)


@dataclasses.dataclass(frozen=True)
class _Work:
    """Findings of the stations so far, with a lock, because several threads add to them."""

    found: dict[int, Finding | None]
    progress: Callable[[int], None]
    lock: threading.Lock

    def keep(self, found: dict[int, Finding | None]) -> None:
        with self.lock:
            self.found.update(found)
            self.progress(len(found))


def _without_each(model: RunModel, seeks: list[dict[int, Taken]], work: _Work, threads: int) -> None:
    """Compute the findings of the stations of these seeks; model: run model that has learned all other stations."""
    if not seeks:
        return
    if len(seeks) == 1:
        work.keep(_of_seek(model, seeks[0]))
        return
    middle = _divided(seeks)
    before, after = seeks[:middle], seeks[middle:]

    def judge(mine: list[dict[int, Taken]], others: list[dict[int, Taken]], threads: int) -> None:
        aware = model.copy()
        for seek in others:
            _learn(aware, seek)
        _without_each(aware, mine, work, threads)

    # The halves do not depend on each other, and the kernels release the interpreter lock.
    if threads < 2:
        judge(before, after[::-1], 1)
        judge(after, before, 1)
        return
    with futures.ThreadPoolExecutor(1) as other:
        second = other.submit(judge, after, before, threads // 2)
        judge(before, after[::-1], threads - threads // 2)
        second.result()


def _divided(seeks: list[dict[int, Taken]]) -> int:
    """
    Return the index at which to divide the seeks.

    The run is divided at the gap nearest the middle in which the string may have changed. Without such a gap, it is
    divided in the middle.
    """
    hazards = [next(iter(seek.values())).hazard for seek in seeks]
    gaps = [k for k in range(1, len(seeks)) if hazards[k] - hazards[k - 1] > _GAP]
    return min(gaps, key=lambda k: abs(2 * k - len(seeks)), default=len(seeks) // 2)


def _of_seek(model: RunModel, seek: dict[int, Taken]) -> dict[int, Finding | None]:
    """
    Return the finding of each station of one seek, by index of the station; None where no sensor measures the azimuth.

    model: run model that has learned the stations outside the seek. In addition, each finding uses the accelerometers
    and magnetometers of the other stations of the seek, but not their gyro azimuths.
    """
    fields = {k: one._replace(gyro=None) for k, one in seek.items()}
    found = {}
    for k, one in seek.items():
        aware = model.copy()
        _learn(aware, {other: field for other, field in fields.items() if other != k})
        found[k] = aware.take(one, learn=False)
    return found
