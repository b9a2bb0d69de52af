# SPDX-License-Identifier: Apache-2.0
"""
Survey results of a table of readings, computed run by run: for each station a first result and a revision.

The first result of a station uses the stations that were taken before it, as a live survey does; its revision uses all
other stations of the run (`revision`). A station whose field disagrees with the other stations does not affect them. If
its azimuth is not accepted, the accepted stations next to it limit the azimuth, because a hole turns little in a stand.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from mwd_estimation.core.reference_field import to_north
from mwd_estimation.core.verdicts import ACCEPT
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.decided_survey import record_of
from mwd_estimation.survey.finding import Finding
from mwd_estimation.survey.measurement import Measured, measured_rows
from mwd_estimation.survey.revision import findings, is_outlier
from mwd_estimation.survey.run_model import Taken, declination_sigma
from mwd_estimation.survey.station_record import MethodAzimuth, Station
from mwd_estimation.survey.station_settings import StationSettings
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_estimation.survey.verdict import judged
from mwd_sensors.core import utc
from mwd_surface.list_files.six_axis_table import TableRow, TableStation
from mwd_surface.surveys import multi_station_analysis
from mwd_surface.surveys.survey_record import SurveyRecord

# Assumed time between two rows if times are missing, h: the time to drill one stand. The drift of an external field is
# computed from this time.
_STAND = 0.5
# Direction of the hole next to an accepted station: 1 sigma of its change per metre, rad, about what a motor builds at
# most; and the largest distance, m, at which it is used.
_DOGLEG, _REACH = math.radians(5.0) / 30.0, 100.0
# Smallest number of stations for a multi-station analysis.
_TOGETHER = 3


@dataclasses.dataclass(frozen=True)
class TableSurvey:
    """A row of a table of readings as a record of a survey list, with the time, run and outlier mark of its row."""

    record: SurveyRecord
    time: str
    run: str
    outlier: bool


def table_surveys(stations: Sequence[TableStation]) -> list[TableSurvey]:
    """Return the rows as surveys, numbered from 1; a time that cannot be read gives stamp 0."""
    return [TableSurvey(_record(number, row), row.time, row.run, row.outlier) for number, row in enumerate(stations, 1)]


def _record(number: int, row: TableStation) -> SurveyRecord:
    now = _survey(number, row, row.station)
    first = () if row.first is None else (_survey(number, row, row.first),)
    used = now.verdict == Verdict.ACCEPT and math.isfinite(row.md)
    return SurveyRecord(now, measured_depth=row.md, first=first, in_use=used)


def _survey(number: int, row: TableStation, station: Station) -> Survey:
    try:
        stamp_ns = round(utc.moment(row.time).timestamp() * 1e9)
    except ValueError:
        stamp_ns = 0
    return record_of(
        station, {}, stamp_ns=stamp_ns, sequence=number, uuid="", requested=True, duration=math.nan, samples=0
    )


def run_stations(
    rows: Sequence[TableRow], settings: StationSettings, progress: Callable[[float], None] | None = None
) -> list[TableStation]:
    """
    Compute the stations of the rows of a table; rows of the same run are computed together.

    The rows of a run may be in any order if all of them have times, or all of them have depths. A row that cannot be
    read is rejected with its reason and is not used for other rows. progress is called with the share of finished rows,
    0 to 1.

    Returns
    -------
    list of TableStation
        One station per row, in the order of the rows. `station` is the result from the whole run, `first` the result
        from this row and the rows taken before it.
    """
    runs: dict[str, list[int]] = {}
    for k, row in enumerate(rows):
        runs.setdefault(row.run, []).append(k)
    found: dict[int, TableStation] = {}
    done = 0.0

    def count(stations: float) -> None:
        nonlocal done
        done += stations
        if progress is not None:
            progress(min(done / len(rows), 1.0))

    for given in runs.values():
        places = _in_order(given, rows)
        found |= zip(places, _run([rows[k] for k in places], settings, count), strict=True)
    return [found[k] for k in range(len(rows))]


def _in_order(places: list[int], rows: Sequence[TableRow]) -> list[int]:
    """Return the rows of a run in the order in which they were taken: by time, or by depth, or else as given."""
    try:
        return sorted(places, key=lambda k: utc.moment(rows[k].time))
    except ValueError:
        known = all(math.isfinite(rows[k].md) for k in places)
        return sorted(places, key=lambda k: rows[k].md) if known else places


def _run(rows: list[TableRow], settings: StationSettings, progress: Callable[[float], None]) -> list[TableStation]:
    f_t, b_t = (np.array(axes) for axes in zip(*((row.f_t, row.b_t) for row in rows), strict=True))
    own = measured_rows(f_t, b_t, [row.reference for row in rows], settings)
    sound = [k for k, row in enumerate(rows) if not row.faults]
    hours = _hours([rows[k].time for k in sound])
    taken = {k: Taken(own[k], hour) for k, hour in zip(sound, hours, strict=True)}
    before, every = findings(list(taken.values()), settings, progress=progress)
    first, final = dict(zip(sound, before, strict=True)), dict(zip(sound, every, strict=True))
    fitting = [k for k in sound if not is_outlier(final[k])]
    if len(fitting) < len(sound):
        _, others = findings([taken[k] for k in fitting], settings, [first[k] for k in fitting])
        final |= zip(fitting, others, strict=True)
    revised = [judged(own[k], final.get(k), settings, row.faults) for k, row in enumerate(rows)]
    by_themselves = list(revised)
    for k, finding in final.items():
        near = _limited(finding, k, rows, by_themselves)
        if near is not finding:
            revised[k] = judged(own[k], near, settings, rows[k].faults)
    stations, together = [], _multi_station(own, fitting, settings)
    for k, (row, station) in enumerate(zip(rows, revised, strict=True)):
        stations.append(
            TableStation(
                row.md,
                row.time,
                dataclasses.replace(station, azimuths=(*station.azimuths, *together.get(k, ()))),
                row.run,
                judged(own[k], first.get(k), settings, row.faults),
                is_outlier(final.get(k)),
            )
        )
    return stations


def _limited(finding: Finding | None, k: int, rows: list[TableRow], stations: list[Station]) -> Finding | None:
    """Return the finding of row k; unless its azimuth is accepted, the nearest accepted stations limit it."""
    one, depth = stations[k], rows[k].md
    if finding is None or one.verdicts.azimuth == ACCEPT:
        return finding
    for side in (-1.0, 1.0):
        near = [
            (side * (row.md - depth), other)
            for row, other in zip(rows, stations, strict=True)
            if 0.0 < side * (row.md - depth) <= _REACH and other.verdicts.azimuth == ACCEPT and other.north == one.north
        ]
        if near:
            apart, other = min(near, key=lambda pair: pair[0])
            turn = min(_DOGLEG * apart / max(math.sin(one.inclination), 1e-3), math.pi)
            finding = finding.near(other.azimuth, math.hypot(other.sigma_azimuth, turn))
    return finding


def _multi_station(
    own: list[Measured], at: list[int], settings: StationSettings
) -> dict[int, tuple[MethodAzimuth, ...]]:
    """
    Return azimuths by multi-station analysis, by index of the station.

    at: indices of the stations to use. The result is empty if fewer than three of these have a field reading, or if
    they do not all have the same reference field.
    """
    read = [(k, own[k].readings, own[k].station) for k in at]
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
    """Return the times of the rows, h; if one row has no valid time, all rows are assumed to be `_STAND` apart."""
    try:
        return [utc.moment(time).timestamp() / 3600.0 for time in times]
    except ValueError:
        return [_STAND * k for k in range(len(times))]
