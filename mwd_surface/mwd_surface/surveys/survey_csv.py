# SPDX-License-Identifier: Apache-2.0
"""
Surveys as CSV: the columns of the signal table, in its order, for every table of surveys that this program writes.

`mwd process`, `mwd survey` and `mwd export` write the same columns with the same meaning. An unknown value is an empty
cell. Text is always in quotes, on one line, and never interpreted as a formula by a spreadsheet.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from mwd_estimation.core.north import North
from mwd_estimation.survey.azimuth_method import AzimuthMethod
from mwd_estimation.survey.survey import AzimuthEstimate, Verdict
from mwd_sensors.core.arrays import Array
from mwd_surface.signals.cells import fixed, quoted, utc
from mwd_surface.signals.table import AS_STORED, PLAN, POSITION, SURVEY_TABLE, Display, Listed, Signal
from mwd_surface.surveys.azimuth_source import azimuth_source
from mwd_surface.surveys.station_quality import Total, totals
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord
from mwd_surface.surveys.well_position import uncertain
from mwd_surface.trajectory.plan import Plan, offset_from
from mwd_surface.trajectory.well_path import Definitive

COLUMNS = tuple(listed.key for _, listed in SURVEY_TABLE)
# Columns of text; all other columns hold numbers.
TEXTS = frozenset(listed.key for signal, listed in SURVEY_TABLE if signal.type in ("String", "Boolean"))
# Additional columns of a table of readings, with their meanings.
OF_TABLES = {
    "time": "time of the station, as written in the table",
    "run": "name of the run, as written in the table",
    "outlier": "yes if the station disagrees with the other stations of its run",
}
_UNKNOWN = AzimuthEstimate("")


class Line:
    """
    Values of a survey for a line of a table; the signal table names the attribute that each column shows.

    All azimuths of a line have the same north, which `north_word` names.

    Parameters
    ----------
    north : North, optional
        North of the azimuths, if they can be converted to it; otherwise they are from the survey's own north.
    """

    station = "survey"

    def __init__(self, record: SurveyRecord, north: North = North.UNKNOWN) -> None:
        self.record, self.survey, self.first = record, record.survey, record.as_first_decided
        self._own = North(self.survey.north)
        #: North of the azimuths.
        self.north = north if self.survey.azimuth_from(north) is not None else self._own

    def __getattr__(self, name: str) -> Any:
        """
        Return the estimate of the azimuth by a method (`by_gyro`), or a component of a reading (`specific_force_x`).

        `verdict`, `verdict_inclination` and so on are the automatic verdicts in words. Raises AttributeError for any
        other name.
        """
        if name.startswith("by_"):
            return self._by(name.removeprefix("by_"))
        if name.startswith("verdict"):
            return _word(getattr(self.survey, name))
        vector, _, axis = name.rpartition("_")
        if vector in ("specific_force", "magnetic_field", "angular_rate") and axis in ("x", "y", "z"):
            return getattr(self.survey, vector)["xyz".index(axis)]
        raise AttributeError(name)

    def value(self, path: str) -> Any:
        """Return the value of an attribute given by a dotted path, such as "survey.sequence"."""
        found: Any = self
        for name in path.split("."):
            found = getattr(found, name)
        return found

    @property
    def azimuth(self) -> float:
        """Definitive azimuth, rad."""
        return self._turned(self.survey.azimuth) if self.survey.has_azimuth else math.nan

    @property
    def north_word(self) -> str:
        """Name of the north of the azimuths; empty without an azimuth."""
        return self.north.name.lower() if self.survey.has_azimuth else ""

    @property
    def magnetic_toolface(self) -> float:
        """Magnetic toolface, from the north of the azimuths, rad."""
        return self._turned(self.survey.magnetic_toolface)

    @property
    def first_azimuth(self) -> float:
        """Azimuth before all revisions of the survey, rad."""
        return self._turned(self.first.azimuth)

    @property
    def alternatives(self) -> str:
        """Other azimuths that fit the readings, deg, separated by blanks."""
        return " ".join(fixed(math.degrees(azimuth), 4, 360.0) for azimuth, _ in self._others)

    @property
    def alternative_odds(self) -> str:
        """Probability of each azimuth in `alternatives`, 0 to 1, separated by blanks."""
        return " ".join(fixed(odds, 4) for _, odds in self._others)

    @property
    def hypotheses(self) -> str:
        """Possible disturbances, each followed by its probability, 0 to 1."""
        pairs = zip(self.survey.hypotheses, self.survey.hypothesis_odds, strict=True)
        return " ".join(f"{name} {fixed(odds, 3)}" for name, odds in pairs)

    @property
    def first_verdict(self) -> str:
        """Automatic verdict before all revisions of the survey."""
        return _word(self.first.verdict)

    @property
    def gyro_share(self) -> float:
        """Share of the gyro in the azimuth, 0 to 1; NaN if unknown."""
        source = azimuth_source(self.survey)
        return source.gyro_share if source.known else math.nan

    @property
    def judged_field(self) -> float | None:
        """Total field that the verdict uses, T; None if it was not measured."""
        return self._totals[1].value

    @property
    def judged_dip(self) -> float | None:
        """Dip that the verdict uses, rad; None if it was not measured."""
        return self._totals[2].value

    @property
    def limits(self) -> Any:
        """Largest deviations of gravity, m/s^2, field, T, and dip, rad, that count as good; above them: doubtful."""
        return _Limits(*(total.limit for total in self._totals))

    @property
    def coordinates(self) -> str:
        """Text "assumed" if the position of the station is based on an assumption; otherwise empty."""
        return "assumed" if self.record.assumed else ""

    @property
    def person(self) -> str:
        """Decision of a person; empty if nobody decided."""
        judgement = Judgement(self.record.judgement)
        return "" if judgement == Judgement.NOT_JUDGED else judgement.name.lower()

    @property
    def time(self) -> str:
        """Middle of the averaging interval, UTC."""
        return utc(self.survey.stamp_ns)

    @property
    def stamp_ns(self) -> int | None:
        """Middle of the averaging interval, ns; None if unknown."""
        return self.survey.stamp_ns or None

    @property
    def duration(self) -> float | None:
        """Averaging time, s; None if nothing was averaged."""
        return self.survey.duration if self.survey.has_readings else None

    @property
    def samples(self) -> int | None:
        """Number of averaged samples; None if nothing was averaged."""
        return self.survey.samples or None

    @property
    def judged(self) -> str:
        """Time at which a person decided, UTC; empty if nobody decided."""
        return utc(self.record.judged_ns)

    @functools.cached_property
    def _totals(self) -> tuple[Total, Total, Total]:
        return totals(self.survey)

    @property
    def _others(self) -> list[tuple[float, float]]:
        return self.survey.alternatives_from(self.north)

    def _turned(self, angle: float) -> float:
        turned = self.survey.turned(angle, self._own, self.north)
        return angle if turned is None else turned

    def _by(self, method: str) -> AzimuthEstimate:
        found = next((one for one in self.survey.azimuths if one.method == method), _UNKNOWN)
        # The azimuth of a refused multi-station analysis is not worth comparing.
        if method == AzimuthMethod.MULTI_STATION and found.reason:
            return _UNKNOWN
        return dataclasses.replace(found, azimuth=self._turned(found.azimuth))


@dataclasses.dataclass(frozen=True)
class _Limits:
    gravity: float
    field: float
    dip: float


def columns(display: Display = AS_STORED) -> tuple[str, ...]:
    """Return the names of the columns for the units and the angle convention of `display`."""
    return tuple(listed.key for _, listed in _table(display))


def cells(record: SurveyRecord, north: North = North.UNKNOWN, display: Display = AS_STORED) -> dict[str, str]:
    """
    Return the cells of a survey, by column name; cells on position sigmas and on the plan are empty.

    north : north of the azimuths if they can be converted to it; otherwise they are from the survey's own north.
    """
    line = Line(record, north)
    return {
        listed.key: _cell(signal, listed, line.value(signal.record), display) if signal.record else ""
        for signal, listed in _table(display)
    }


def list_cells(surveys: SurveyList, display: Display = AS_STORED) -> list[dict[str, str]]:
    """Return the cells of every survey of a list, in order of survey number; azimuths are from each survey's north."""
    beside: dict[int, dict[str, str]] = {}
    for leg in surveys.legs:
        path = surveys.definitive(leg.name)
        found = beside_path(path, uncertain(surveys, path).covariance, surveys.plan)
        for k, record in enumerate(surveys.records_on(path)):
            if record is not None and record.leg == leg.name:
                values = {source: rows[k] for source, rows in found.items()}
                beside[record.survey.sequence] = {
                    listed.key: _cell(signal, listed, values[signal.source].get(signal.field, math.nan), display)
                    for signal, listed in _table(display)
                    if signal.source in values
                }
    ordered = sorted(surveys.records, key=lambda record: record.survey.sequence)
    return [cells(record, display=display) | beside.get(record.survey.sequence, {}) for record in ordered]


def beside_path(path: Definitive, covariance: Array | None, plan: Plan | None) -> dict[str, list[Mapping[str, Any]]]:
    """
    Return the position sigmas of each station of a path, and its offset from the plan, in SI units.

    The keys are `POSITION` and, if there is a plan, `PLAN`; each has one mapping, field to value, for each station.
    """
    found: dict[str, list[Mapping[str, Any]]] = {
        POSITION: [{} for _ in path.md] if covariance is None else [_sigmas(one) for one in covariance]
    }
    if plan is not None:
        angles = zip(path.positions, path.inclination, path.azimuth, strict=True)
        found[PLAN] = [vars(offset_from(plan, p, float(i), float(a))) for p, i, a in angles]
    return found


def text(lines: Iterable[Mapping[str, str]], more: Sequence[str] = (), display: Display = AS_STORED) -> str:
    """
    Return the text of a CSV file with header and lines; missing cells are empty.

    more : names of additional columns at the end.
    display : display with which the lines were made.
    """
    names = (*columns(display), *more)
    quote = TEXTS | set(more)
    rows = [",".join(names)]
    rows += [",".join(quoted(line.get(n, "")) if n in quote else line.get(n, "") for n in names) for line in lines]
    return "\n".join(rows) + "\n"


@functools.lru_cache(maxsize=16)
def _table(display: Display) -> list[tuple[Signal, Listed]]:
    return [(signal, signal.column_for_people(listed, display)) for signal, listed in SURVEY_TABLE]


def _cell(signal: Signal, listed: Listed, value: Any, display: Display = AS_STORED) -> str:
    """Return the text of a cell; a number is in the unit that the name of the column gives."""
    if signal.type == "String":
        return "; ".join(value) if isinstance(value, tuple) else str(value)
    if signal.type == "Boolean":
        return "yes" if value else "no"
    if value is None or not math.isfinite(value):
        return ""
    if signal.type == "Int64":
        return str(value)
    number = signal.for_people(value, display)
    return fixed(number % signal.wrap if signal.circle else number, listed.decimals, signal.wrap)


def _sigmas(covariance: Array) -> dict[str, float]:
    if not np.all(np.isfinite(covariance)):
        return {}
    names = ("sigma_north", "sigma_east", "sigma_vertical")
    return dict(zip(names, np.sqrt(np.maximum(np.diagonal(covariance), 0.0)), strict=True))


def _word(verdict: int) -> str:
    return Verdict(verdict).name.lower()
