# SPDX-License-Identifier: Apache-2.0
"""
A survey and its line in the survey list; fields as in the messages of the same names.

Numbers are in SI and rad; an unknown number is NaN. `settings.to_mapping` and `settings.from_mapping` convert both to
plain tables and back, NaN to null.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import Any

from mwd_estimation.core.reason_text import HYPOTHESES
from mwd_estimation.core.verdicts import MOVED
from mwd_sensors.core import settings
from mwd_sensors.core.settings import Number
from mwd_surface.trajectory.north import North

Three = tuple[Number, Number, Number]
Nine = tuple[Number, Number, Number, Number, Number, Number, Number, Number, Number]
UNKNOWN_3: Three = (math.nan,) * 3
UNKNOWN_9: Nine = (math.nan,) * 9
# Kinds of a survey, with the numbers of its message.
STATIC, ROTARY = 0, 1


class Verdict(enum.IntEnum):
    """Automatic verdict, with the numbers of the Survey message; NOT_DETERMINED occurs for single quantities only."""

    ACCEPT = 0
    DOUBTFUL = 1
    REJECT = 2
    NOT_DETERMINED = 3

    @property
    def word(self) -> str:
        """Text for people and files."""
        return self.name.lower().replace("_", " ")


class Judgement(enum.IntEnum):
    """Decision of an operator, with the numbers of the SurveyRecord message."""

    NOT_JUDGED = 0
    ACCEPTED = 1
    REJECTED = 2


class Value(enum.IntEnum):
    """Which value of a survey a person accepts, with the numbers of the JudgeSurvey request."""

    DEFINITIVE = 0
    REVISED = 1
    FIRST = 2


RECEIVED_OVER = "received over "
"""Beginning of the reason that names the links over which a survey came."""


class _Comparable:
    """Equality of records field by field, where an unknown number equals an unknown number."""

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        names = [field.name for field in dataclasses.fields(self)]  # type: ignore[arg-type]
        return all(_same(getattr(self, name), getattr(other, name)) for name in names)

    __hash__ = None  # type: ignore[assignment]


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other or (one != one and other != other))


@dataclasses.dataclass(frozen=True, eq=False)
class AzimuthEstimate(_Comparable):
    """Azimuth by one method: rad from `north`, 1 sigma in rad, weight in the fused azimuth."""

    method: str
    north: int = int(North.UNKNOWN)
    azimuth: Number = math.nan
    sigma: Number = math.nan
    weight: float = 0.0
    reason: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class Survey(_Comparable):
    """A station as measured and judged by the estimator; units as in Survey.msg, stamp in ns."""

    stamp_ns: int
    uuid: str
    sequence: int
    inclination: float
    azimuth: Number
    north: int
    frame_id: str = "sonde_link"
    kind: int = STATIC
    requested: bool = False
    duration: float = 0.0
    samples: int = 0
    specific_force: Three = UNKNOWN_3
    specific_force_covariance: Nine = UNKNOWN_9
    magnetic_field: Three = UNKNOWN_3
    magnetic_field_covariance: Nine = UNKNOWN_9
    angular_rate: Three = UNKNOWN_3
    temperature: Number = math.nan
    gravity_toolface: Number = math.nan
    magnetic_toolface: Number = math.nan
    covariance: Nine = UNKNOWN_9
    azimuth_method: str = ""
    azimuths: tuple[AzimuthEstimate, ...] = ()
    g_total: Number = math.nan
    b_total: Number = math.nan
    dip: Number = math.nan
    g_reference: Number = math.nan
    b_reference: Number = math.nan
    dip_reference: Number = math.nan
    declination: Number = math.nan
    convergence: Number = math.nan
    reference_source: str = ""
    axial_interference: Number = math.nan
    sigma_axial_interference: Number = math.nan
    g_deviation: Number = math.nan
    b_deviation: Number = math.nan
    dip_deviation: Number = math.nan
    g_limit: Number = math.nan
    b_limit: Number = math.nan
    dip_limit: Number = math.nan
    verdict: int = int(Verdict.ACCEPT)
    verdict_inclination: int = int(Verdict.ACCEPT)
    verdict_azimuth: int = int(Verdict.ACCEPT)
    verdict_toolface: int = int(Verdict.ACCEPT)
    headline: str = ""
    reasons: tuple[str, ...] = ()
    alternatives: tuple[float, ...] = ()
    alternative_odds: tuple[float, ...] = ()
    hypotheses: tuple[str, ...] = ()
    hypothesis_odds: tuple[float, ...] = ()
    status: int = 0
    revision: int = 0
    withdrawn: bool = False

    @property
    def verdicts(self) -> tuple[str, str, str]:
        """Automatic verdicts of inclination, azimuth and toolface, in one word each."""
        given = (self.verdict_inclination, self.verdict_azimuth, self.verdict_toolface)
        return Verdict(given[0]).word, Verdict(given[1]).word, Verdict(given[2]).word

    @property
    def link(self) -> str:
        """Links over which the survey came; empty if it came directly from the tool."""
        named = [one.removeprefix(RECEIVED_OVER) for one in self.reasons if one.startswith(RECEIVED_OVER)]
        return named[-1] if named else ""

    @property
    def action(self) -> str:
        """Main reason to act; in older lists without a headline, the first reason of the verdict."""
        return self.headline or (self.reasons[0] if self.reasons and self.verdict != Verdict.ACCEPT else "")

    @property
    def disturbances(self) -> list[tuple[str, float]]:
        """Possible disturbances with their probabilities, most likely first; negligible ones are left out."""
        pairs = zip(self.hypotheses, self.hypothesis_odds, strict=True)
        known = sorted(((odds, name) for name, odds in pairs if odds >= 0.005), reverse=True)
        return [(HYPOTHESES.get(name, name), odds) for odds, name in known]

    def alternatives_from(self, north: North) -> list[tuple[float, float]]:
        """Return other azimuths that fit, rad, and their odds; from the survey's own north if `north` is unknown."""
        pairs = zip(self.alternatives, self.alternative_odds, strict=True)
        turned = ((self.turned(azimuth, North(self.north), north), azimuth, odds) for azimuth, odds in pairs)
        return [(own % math.tau if found is None else found, odds) for found, own, odds in turned]

    @property
    def has_azimuth(self) -> bool:
        """Whether the survey has an azimuth, that is, the estimator did not withhold it."""
        return math.isfinite(self.azimuth) and self.north != North.UNKNOWN

    @property
    def has_readings(self) -> bool:
        """Whether the readings are known; false for an imported station with angles only."""
        return math.isfinite(self.g_total)

    @property
    def toolfaces(self) -> tuple[float | None, float | None]:
        """Gravity and magnetic toolface, rad; None if not measured, as for a rotating tool."""
        if self.kind == ROTARY or not self.has_readings:
            return None, None
        return self.gravity_toolface, self.magnetic_toolface if self.has_azimuth else None

    @property
    def has_reference(self) -> bool:
        """Whether a reference field was configured."""
        return math.isfinite(self.b_reference)

    @property
    def sigma_inclination(self) -> float:
        """1 sigma, rad."""
        return math.sqrt(self.covariance[0])

    @property
    def sigma_azimuth(self) -> float:
        """1 sigma, rad."""
        return math.sqrt(self.covariance[4])

    @property
    def sigma_toolface(self) -> float:
        """1 sigma of the gravity toolface, rad."""
        return math.sqrt(self.covariance[8])

    def azimuth_from(self, north: North) -> float | None:
        """Return the azimuth from a given north, rad in [0, 2 pi), or None if it cannot be converted; see `turned`."""
        return self.turned(self.azimuth, North(self.north), north) if self.has_azimuth else None

    def turned(self, azimuth: float, given: North, north: North) -> float | None:
        """
        Convert an azimuth at this survey's place from one north to another, rad in [0, 2 pi); None if not possible.

        True = magnetic + declination, grid = true - convergence. The declination needs a reference field.
        """
        if North.UNKNOWN in (given, north):
            return None
        if given == north:
            return azimuth % math.tau
        if North.MAGNETIC in (given, north) and not self.has_reference:
            return None
        to_true = {North.MAGNETIC: self.declination, North.TRUE: 0.0, North.GRID: self.convergence}
        before, after = to_true[given], to_true[north]
        turned = (azimuth + before - after) % math.tau
        return turned if math.isfinite(turned) else None


@dataclasses.dataclass(frozen=True, eq=False)
class Decision(_Comparable):
    """A person's decision about a survey: `Judgement`, name, reason, time, ns, and depth at that time, m."""

    judgement: int
    operator_name: str
    reason: str
    stamp_ns: int
    measured_depth: Number


COORDINATES_ASSUMED = "coordinates assumed"  # flag of a record
#: Fields of a record that follow from the path; NaN unless the record is in use.
PLACE = ("north", "east", "vertical_depth", "vertical_section", "dogleg_severity", "build_rate", "turn_rate")


@dataclasses.dataclass(frozen=True, eq=False)
class SurveyRecord(_Comparable):
    """
    One line of the survey list: survey, depth, decisions, place on the path; as in SurveyRecord.msg.

    A record holds up to three values of its survey. `survey` is the definitive one, which path, files and rig
    interfaces use. `first` is the value as first decided, if it has been replaced. `revised` is the estimator's revised
    value from the whole run, if it was not made definitive because a person has decided or must still decide.

    decisions: all decisions, oldest first; the last one is in force. They are kept in the file of the list only.
    decided_revision: revision that was present at the last decision; kept in the file only.

    The fields from `north` on are derived from the list and recomputed with it (m, rad/m; NaN unless `in_use`).
    """

    survey: Survey
    measured_depth: Number = math.nan
    depth_age: Number = math.nan
    judgement: int = int(Judgement.NOT_JUDGED)
    operator_name: str = ""
    reason: str = ""
    judged_ns: int = 0
    in_use: bool = False
    leg: str = ""
    tool: str = ""
    comment: str = ""
    decisions: tuple[Decision, ...] = ()
    first: tuple[Survey, ...] = ()
    revised: tuple[Survey, ...] = ()
    decided_revision: int = 0
    north: Number = math.nan
    east: Number = math.nan
    vertical_depth: Number = math.nan
    vertical_section: Number = math.nan
    dogleg_severity: Number = math.nan
    build_rate: Number = math.nan
    turn_rate: Number = math.nan
    flags: tuple[str, ...] = ()

    @property
    def assumed(self) -> bool:
        """Whether the station's place on the path rests on an assumption, which the path names."""
        return COORDINATES_ASSUMED in self.flags

    @property
    def as_first_decided(self) -> Survey:
        """Survey as first decided, which never changes."""
        return self.first[0] if self.first else self.survey

    @property
    def proposal(self) -> Survey | None:
        """The revised value that was not made definitive, if it differs from the definitive one; otherwise None."""
        return self.revised[-1] if self.revised and differ(self.survey, self.revised[-1]) else None

    @property
    def replaced(self) -> Survey | None:
        """Survey as first decided, if the definitive value differs from it; otherwise None."""
        return self.first[0] if self.first and differ(self.first[0], self.survey) else None

    @property
    def revised_because(self) -> str:
        """Why the definitive value differs from the first one, in words; empty if it does not."""
        return "" if self.replaced is None else self.survey.action or "magnetic field at the later surveys"

    @property
    def newest_revision(self) -> int:
        """Number of the newest result of the estimator that the record knows."""
        return max(one.revision for one in (self.survey, *self.first, *self.revised))

    @property
    def azimuth_doubt(self) -> str:
        """Sentence on an azimuth that is not to be relied on, with the reason; empty if it is reliable or absent."""
        verdict = Verdict(self.survey.verdict_azimuth)
        if verdict in (Verdict.ACCEPT, Verdict.NOT_DETERMINED):
            return ""
        place = f" at {self.measured_depth:.1f} m" if math.isfinite(self.measured_depth) else ""
        return f"survey {self.survey.sequence}{place}: azimuth {verdict.word}: {self.survey.action}"


def differ(one: Survey, other: Survey) -> bool:
    """Whether two results of a survey have another verdict, or azimuths further apart than `MOVED`."""
    if (one.verdict, one.verdict_azimuth) != (other.verdict, other.verdict_azimuth):
        return True
    if not (math.isfinite(one.azimuth) and math.isfinite(other.azimuth)):
        return math.isfinite(one.azimuth) != math.isfinite(other.azimuth)
    return abs(math.remainder(other.azimuth - one.azimuth, math.tau)) > MOVED


def checked_survey(survey: Survey) -> Survey:
    """
    Return the survey after checking that every value has its declared type and is finite, and angles are in range.

    Raises
    ------
    ValueError
        A value is wrong; the message names the field, its value and the rule.
    """
    whole = settings.from_mapping(Survey, settings.to_mapping(survey), "survey")
    if not whole.uuid:
        raise ValueError("survey.uuid: must not be empty")
    if whole.sequence < 1:
        raise ValueError(f"survey.sequence: must be 1 or more, got {whole.sequence}")
    if not 0.0 <= whole.inclination <= math.pi:
        raise ValueError(f"survey.inclination: must be within 0 and pi rad, got {whole.inclination}")
    if whole.azimuth < 0.0 or whole.azimuth > math.tau:
        raise ValueError(f"survey.azimuth: must be within 0 and 2 pi rad, got {whole.azimuth}")
    for name, kind in (("north", North), ("verdict", Verdict)):
        value = getattr(whole, name)
        if value not in list(kind):
            raise ValueError(f"survey.{name}: expected {', '.join(str(int(v)) for v in kind)}, got {value}")
    return whole
