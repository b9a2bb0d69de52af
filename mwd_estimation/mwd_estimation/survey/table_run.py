# SPDX-License-Identifier: Apache-2.0
"""
The stations of one run together: what each said when it was taken, and what it says with all of the run.

The first value of a station knows the stations above it in the table, as the live one does; its revision knows every
other station of the run, and no station counts for itself twice. A station whose field is not that of the others tells
them nothing. The others of each station are taken in by halves, so that n stations need some n log2(n) steps.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from mwd_estimation.core.reference_field import to_north
from mwd_estimation.survey import multi_station_analysis
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.finding import Finding
from mwd_estimation.survey.measurement import Measured, measured
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.run_model import RunModel, declination_sigma
from mwd_estimation.survey.six_axis_table import TableRow, TableStation
from mwd_estimation.survey.station_record import MethodAzimuth
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.verdict import judged
from mwd_sensors.core import utc

# Probability of an external field from which the others of the run speak against a station.
_OUTLIER = 0.5
# Between two rows without a time, h: a stand. How a field from outside drifts follows from it.
_STAND = 0.5
# A multi-station analysis is compared from so many stations on.
_TOGETHER = 3


def run_stations(rows: Sequence[TableRow], settings: StationSettings) -> list[TableStation]:
    """
    Compute the rows of a table, those of one run together.

    Rows are in the order in which they were taken. A row that cannot be read is rejected with its reason and tells
    nothing of the others.

    Returns
    -------
    list of TableStation
        One for each row, in order; `station` knows all of its run, `first` the rows before it.
    """
    runs: dict[str, list[int]] = {}
    for k, row in enumerate(rows):
        runs.setdefault(row.run, []).append(k)
    found: dict[int, TableStation] = {}
    for places in runs.values():
        found |= zip(places, _run([rows[k] for k in places], settings), strict=True)
    return [found[k] for k in range(len(rows))]


def _run(rows: list[TableRow], settings: StationSettings) -> list[TableStation]:
    own = [measured(row.f_t, row.b_t, row.reference, settings) for row in rows]
    sound = [k for k, row in enumerate(rows) if not row.faults]
    hours = dict(zip(sound, _hours([rows[k].time for k in sound]), strict=True))
    model = RunModel(settings)
    first = {k: model.take(own[k], hours[k]) for k in sound}
    final: dict[int, Finding | None] = {}
    if sound:
        _revise(RunModel(settings), sound, own, hours, final)
    fitting = [k for k in sound if not _outlier(final[k])]
    if 0 < len(fitting) < len(sound):
        _revise(RunModel(settings), fitting, own, hours, final)
    stations, together = [], _multi_station(own, sound, settings)
    for k, row in enumerate(rows):
        last = final.get(k)
        station = judged(own[k], last, settings, row.faults)
        stations.append(
            TableStation(
                row.md,
                row.time,
                dataclasses.replace(station, azimuths=(*station.azimuths, *together.get(k, ()))),
                row.run,
                judged(own[k], first.get(k), settings, row.faults),
                _outlier(last),
            )
        )
    return stations


def _outlier(finding: Finding | None) -> bool:
    return finding is not None and finding.hypotheses.get(Hypothesis.EXTERNAL, 0.0) > _OUTLIER


def _revise(
    model: RunModel, at: list[int], own: list[Measured], hours: dict[int, float], found: dict[int, Finding | None]
) -> None:
    """Findings of stations `at`, by a model that has learned of every station but these."""
    if len(at) == 1:
        found[at[0]] = model.take(own[at[0]], hours[at[0]], learn=False)
        return
    half = len(at) // 2
    for mine, others in ((at[:half], at[half:]), (at[half:], at[:half])):
        aware = copy.deepcopy(model)
        for k in others:
            aware.take(own[k], hours[k])
        _revise(aware, mine, own, hours, found)


def _multi_station(
    own: list[Measured], sound: list[int], settings: StationSettings
) -> dict[int, tuple[MethodAzimuth, ...]]:
    """Azimuths by multi-station analysis, for comparison, by place in the run; none without one field for all."""
    read = [(k, own[k].readings, own[k].station) for k in sound]
    usable = [(k, readings, station) for k, readings, station in read if readings is not None and readings.has_field]
    references = {station.reference for _, _, station in usable}
    reference = references.pop() if len(references) == 1 else None
    if len(usable) < _TOGETHER or reference is None or not reference.has_field:
        return {}
    f_h, b_h = (np.stack(part) for part in zip(*((one.f_h, one.b_h) for _, one, _ in usable), strict=True))
    done = multi_station_analysis.analyse(f_h, b_h, reference, settings.errors)
    found: dict[int, tuple[MethodAzimuth, ...]] = {}
    for (k, _, station), azimuth, sigma in zip(usable, done.azimuth, done.sigma_azimuth, strict=True):
        whole = min(math.hypot(float(sigma), declination_sigma(station)), math.pi)
        north = to_north(float(azimuth), station.north_correction)
        found[k] = (MethodAzimuth(AzimuthMethod.MULTI_STATION, north, whole, done.refused),)
    return found


def _hours(times: list[str]) -> list[float]:
    """Times of the rows, h; those of stand after stand where not all rows have one."""
    try:
        return [utc.moment(time).timestamp() / 3600.0 for time in times]
    except ValueError:
        return [_STAND * k for k in range(len(times))]
