# SPDX-License-Identifier: Apache-2.0
"""
The stations of one run together: what each said when it was taken, and what it says with all of the run.

The first value of a station knows the stations above it in the table, as the live one does; its revision knows every
other station of the run, and no station counts for itself twice. A station whose field is not that of the others tells
them nothing. The others of each station are taken in by halves, so that n stations need some n log2(n) steps.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

from mwd_estimation.survey.finding import Finding
from mwd_estimation.survey.measurement import Measured, measured
from mwd_estimation.survey.posterior.hypotheses import Hypothesis
from mwd_estimation.survey.run_model import RunModel
from mwd_estimation.survey.six_axis_table import TableRow, TableStation
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.verdict import judged
from mwd_sensors.core import utc

# Probability of an external field from which the others of the run speak against a station.
_OUTLIER = 0.5


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
    hours = [_hours(row.time) for row in rows]
    model = RunModel(settings)
    first = [None if row.faults else model.take(m, h) for row, m, h in zip(rows, own, hours, strict=True)]
    sound = [k for k, row in enumerate(rows) if not row.faults]
    final: dict[int, Finding | None] = {}
    if sound:
        _revise(RunModel(settings), sound, own, hours, final)
    fitting = [k for k in sound if not _outlier(final[k])]
    if 0 < len(fitting) < len(sound):
        _revise(RunModel(settings), fitting, own, hours, final)
    stations = []
    for k, row in enumerate(rows):
        last = final.get(k)
        stations.append(
            TableStation(
                row.md,
                row.time,
                judged(own[k], last, settings, row.faults),
                row.run,
                judged(own[k], first[k], settings, row.faults),
                _outlier(last),
            )
        )
    return stations


def _outlier(finding: Finding | None) -> bool:
    return finding is not None and finding.hypotheses.get(Hypothesis.EXTERNAL, 0.0) > _OUTLIER


def _revise(
    model: RunModel, at: list[int], own: list[Measured], hours: list[float], found: dict[int, Finding | None]
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


def _hours(time: str) -> float:
    """Time of a row as written, h since 1970; nan where it is none."""
    try:
        return utc.moment(time).timestamp() / 3600.0
    except ValueError:
        return math.nan
