# SPDX-License-Identifier: Apache-2.0
"""
A line of the survey list: a survey of the estimator with its depth, decisions of people, and place on the path.

The fields are those of mwd_msgs/msg/SurveyRecord. Numbers are in SI and rad; an unknown number is NaN.
`settings.to_mapping` and `settings.from_mapping` convert a record to plain tables and back, NaN to null.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import ClassVar

from mwd_estimation.core.north import North
from mwd_estimation.core.verdicts import MOVED
from mwd_estimation.survey.survey import Survey, Verdict
from mwd_sensors.core import settings
from mwd_sensors.core.message_record import MessageRecord
from mwd_sensors.core.settings import Number


class Judgement(enum.IntEnum):
    """Decision of an operator, with the numbers of the SurveyRecord message."""

    NOT_JUDGED = 0
    ACCEPTED = 1
    REJECTED = 2


class Value(enum.IntEnum):
    """Kind of value of a survey that a person can accept, with the numbers of the JudgeSurvey request."""

    DEFINITIVE = 0
    REVISED = 1
    FIRST = 2

    @classmethod
    def _missing_(cls, value: object) -> None:
        raise ValueError(f"value: must be 0 (definitive), 1 (revised) or 2 (first), got {value}")


@dataclasses.dataclass(frozen=True, eq=False)
class SurveyDecisionRecord(MessageRecord):
    """A person's decision about a survey: `Judgement`, name, reason, time in ns, and depth at that time in m."""

    judgement: int
    operator_name: str
    reason: str
    stamp_ns: int
    measured_depth: Number


COORDINATES_ASSUMED = "coordinates assumed"  # flag of a record
#: Fields of a record that follow from the path; NaN unless the record is in use.
PLACE = ("north", "east", "vertical_depth", "vertical_section", "dogleg_severity", "build_rate", "turn_rate")


@dataclasses.dataclass(frozen=True, eq=False)
class SurveyRecord(MessageRecord):
    """
    One line of the survey list: survey, depth, decisions, place on the path; as in SurveyRecord.msg.

    A record holds up to three values of its survey. `survey` is the definitive one, which path, files and rig
    interfaces use. `first` is the value as first decided, if it has been replaced. `revised` is the estimator's revised
    value from the whole run, if it was not made definitive because a person has decided or must still decide.

    `decisions` and `decided_revision` are kept in the file of the list, but not in messages.

    The fields from `north` on are derived from the list and recomputed with it (m, rad/m; NaN unless `in_use`).
    """

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/SurveyRecord"
    NOT_SENT: ClassVar[frozenset[str]] = frozenset({"decisions", "decided_revision"})

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
    #: Remarks of the program, joined by "; ": reason for a missing depth, effects of a decision. Texts of people are in
    #: `reason`.
    comment: str = ""
    decisions: tuple[SurveyDecisionRecord, ...] = ()  #: all decisions, oldest first; the last one is in force
    first: tuple[Survey, ...] = ()
    revised: tuple[Survey, ...] = ()
    decided_revision: int = 0  #: newest revision number at the time of the last decision
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
        """Whether the station's place on the path is based on an assumption (`Definitive.assumptions`)."""
        return COORDINATES_ASSUMED in self.flags

    @property
    def as_first_decided(self) -> Survey:
        """First value of the survey, before all revisions; it never changes."""
        return self.first[0] if self.first else self.survey

    @property
    def proposal(self) -> Survey | None:
        """The revised value that was not made definitive, if it differs from the definitive one; otherwise None."""
        return self.revised[-1] if self.revised and differ(self.survey, self.revised[-1]) else None

    @property
    def replaced(self) -> Survey | None:
        """First value of the survey, if the definitive value differs from it; otherwise None."""
        return self.first[0] if self.first and differ(self.first[0], self.survey) else None

    @property
    def revised_because(self) -> str:
        """Reason why the definitive value differs from the first value, in words; empty if it does not differ."""
        return "" if self.replaced is None else self.survey.action or "magnetic field at the later surveys"

    @property
    def newest_revision(self) -> int:
        """Revision number of the newest result of the estimator in this record; 0 is the first value."""
        return max(one.revision for one in (self.survey, *self.first, *self.revised))

    @property
    def azimuth_doubt(self) -> str:
        """Sentence on a doubtful or rejected azimuth, with the reason; empty if the azimuth is accepted or absent."""
        verdict = Verdict(self.survey.verdict_azimuth)
        if verdict in (Verdict.ACCEPT, Verdict.NOT_DETERMINED):
            return ""
        place = f" at {self.measured_depth:.1f} m" if math.isfinite(self.measured_depth) else ""
        return f"survey {self.survey.sequence}{place}: azimuth {verdict.word}: {self.survey.action}"


def differ(one: Survey, other: Survey) -> bool:
    """
    Return whether two results of a survey differ.

    They differ if a verdict differs, if only one has an azimuth, or if the azimuths are more than `MOVED` rad apart.
    """
    if (one.verdict, one.verdict_azimuth) != (other.verdict, other.verdict_azimuth):
        return True
    if not (math.isfinite(one.azimuth) and math.isfinite(other.azimuth)):
        return math.isfinite(one.azimuth) != math.isfinite(other.azimuth)
    return abs(math.remainder(other.azimuth - one.azimuth, math.tau)) > MOVED


def checked_survey(survey: Survey) -> Survey:
    """
    Return a copy of the survey after checking its values: types, finite numbers (or NaN if allowed), and ranges.

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
