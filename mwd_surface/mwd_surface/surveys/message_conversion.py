# SPDX-License-Identifier: Apache-2.0
"""
Conversion between the graph's messages and the records of the survey list, field by field and by name.

No ROS code is imported: a message is any object with the fields of its .msg file, and the node passes the empty
messages to fill. Both sides hold the same SI numbers, so only stamps and arrays are converted.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from mwd_estimation.survey.survey import Survey as EstimatedSurvey
from mwd_estimation.survey.survey_message import survey_fields
from mwd_surface.list_files.remark import Remark, RemarkKind, sentences
from mwd_surface.surveys.leg import Leg, Origin, TieOn
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import AzimuthEstimate, Decision, Judgement, Survey, SurveyRecord
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.advice import Advice, AdviceMode
from mwd_surface.trajectory.plan import Plan, plan_of
from mwd_surface.trajectory.well_path import ASSUMED, PROJECTED, Definitive

_SECOND = 10**9
# Fields that on the message are part of the header, or messages of their own.
_OWN_WAY = {"stamp_ns", "frame_id", "azimuths"}
# Fields that are on no message; only the file of the list has them.
_OF_THE_FILE = {"decisions", "decided_revision"}

# Numbers of a tie-on, with the same names in Leg.msg and `TieOn`.
_TIE_ON = ("measured_depth", "inclination", "azimuth", "north", "east", "vertical_depth")
# Numbers of SteeringAdvice that are None in `Advice` where unknown.
_MAY_BE_UNKNOWN = (
    "sigma",
    "confidence",
    "from_depth",
    "slide_to_depth",
    "to_depth",
    "dogleg_severity",
    "motor_yield",
)


def stamp_of(time: Any) -> int:
    """Return the nanoseconds of a builtin_interfaces/Time."""
    return int(time.sec) * _SECOND + int(time.nanosec)


def fill_stamp(time: Any, stamp_ns: int) -> None:
    """Write nanoseconds into a builtin_interfaces/Time."""
    time.sec, time.nanosec = divmod(int(stamp_ns), _SECOND)


def survey_of(message: Any) -> Survey:
    """Return the Survey of a mwd_msgs/msg/Survey; the list checks its values when it is added."""
    values: dict[str, Any] = {"stamp_ns": stamp_of(message.header.stamp), "frame_id": str(message.header.frame_id)}
    for field in dataclasses.fields(Survey):
        if field.name not in _OWN_WAY:
            values[field.name] = _plain(getattr(message, field.name))
    values["azimuths"] = tuple(
        AzimuthEstimate(**{f.name: _plain(getattr(a, f.name)) for f in dataclasses.fields(AzimuthEstimate)})
        for a in message.azimuths
    )
    return Survey(**values)


def survey_of_estimate(survey: EstimatedSurvey) -> Survey:
    """Return the Survey that the message of an estimator's survey would give."""
    return survey_of_fields(survey_fields(survey), survey.stamp_ns)


def survey_of_fields(fields: Mapping[str, Any], stamp_ns: int) -> Survey:
    """Return the Survey of such a message's fields by name, as the estimator's `survey_fields` makes them."""
    values = {name: _plain(value) for name, value in fields.items() if name not in _OWN_WAY}
    azimuths = tuple(AzimuthEstimate(**one) for one in fields["azimuths"])
    return Survey(stamp_ns=stamp_ns, azimuths=azimuths, **values)


def fill_survey(message: Any, survey: Survey, new_azimuth: Callable[[], Any]) -> None:
    """Write a survey into an empty mwd_msgs/msg/Survey; new_azimuth returns an empty mwd_msgs/msg/AzimuthEstimate."""
    fill_stamp(message.header.stamp, survey.stamp_ns)
    message.header.frame_id = survey.frame_id
    for field in dataclasses.fields(Survey):
        if field.name not in _OWN_WAY:
            _fill(message, field.name, getattr(survey, field.name))
    message.azimuths = []
    for estimate in survey.azimuths:
        azimuth = new_azimuth()
        for field in dataclasses.fields(AzimuthEstimate):
            _fill(azimuth, field.name, getattr(estimate, field.name))
        message.azimuths.append(azimuth)


def record_of(message: Any) -> SurveyRecord:
    """Return the SurveyRecord of a mwd_msgs/msg/SurveyRecord."""
    values: dict[str, Any] = {
        "survey": survey_of(message.survey),
        "first": tuple(survey_of(one) for one in message.first),
        "revised": tuple(survey_of(one) for one in message.revised),
        "judged_ns": stamp_of(message.judged),
    }
    for field in dataclasses.fields(SurveyRecord):
        if field.name not in values and field.name not in _OF_THE_FILE:
            values[field.name] = _plain(getattr(message, field.name))
    record = SurveyRecord(**values)
    if record.judgement == Judgement.NOT_JUDGED:
        return record
    # A message holds only the decision in force.
    last = Decision(record.judgement, record.operator_name, record.reason, record.judged_ns, record.measured_depth)
    return dataclasses.replace(record, decisions=(last,))


def fill_record(message: Any, record: SurveyRecord, new_azimuth: Callable[[], Any]) -> None:
    """Write a record into an empty mwd_msgs/msg/SurveyRecord."""
    # An empty message of a survey, for those in the arrays.
    empty = copy.deepcopy(message.survey)
    for name in ("first", "revised"):
        setattr(message, name, [])
        for survey in getattr(record, name):
            other = copy.deepcopy(empty)
            fill_survey(other, survey, new_azimuth)
            getattr(message, name).append(other)
    fill_survey(message.survey, record.survey, new_azimuth)
    fill_stamp(message.judged, record.judged_ns)
    for field in dataclasses.fields(SurveyRecord):
        if field.name not in {"survey", "first", "revised", "judged_ns", *_OF_THE_FILE}:
            _fill(message, field.name, getattr(record, field.name))


def list_of(message: Any, well: Well, rules: ListRules | None = None) -> SurveyList:
    """
    Return the SurveyList of a mwd_msgs/msg/SurveyList, with the well and rules, which the message does not hold.

    Raises
    ------
    ValueError
        The path through its stations cannot be computed.
    """
    legs = tuple(
        Leg(
            str(one.name),
            TieOn(**{name: float(getattr(one, name)) for name in _TIE_ON}, source=Origin(one.source)),
            str(one.parent),
        )
        for one in message.legs
    )
    records = tuple(record_of(record) for record in message.records)
    bare = SurveyList(
        well=well,
        rules=rules or ListRules(),
        legs=legs,
        records=records,
        leg=str(message.leg),
        changed_ns=stamp_of(message.header.stamp),
        plan=plan_of_message(message.plan),
        remarks=_remarks_of(message),
    )
    return SurveyList.from_mapping(bare.to_mapping(), rules)


def plan_of_message(message: Any) -> Plan | None:
    """Return the plan of a mwd_msgs/msg/Plan; None if it has no stations."""
    if not len(message.measured_depth):
        return None
    angles = message.inclination, message.azimuth
    plan = plan_of(message.measured_depth, *angles, message.start, str(message.north), str(message.name))
    return dataclasses.replace(plan, remarks=_remarks_of(message))


def fill_list(
    message: Any,
    surveys: SurveyList,
    new_record: Callable[[], Any],
    new_azimuth: Callable[[], Any],
    new_leg: Callable[[], Any],
    new_remark: Callable[[], Any],
) -> None:
    """Write a list into an empty mwd_msgs/msg/SurveyList, except for the frame."""
    fill_stamp(message.header.stamp, surveys.changed_ns)
    message.well = surveys.well.name
    message.records = []
    for record in surveys.records:
        line = new_record()
        fill_record(line, record, new_azimuth)
        message.records.append(line)
    message.leg = surveys.leg
    message.legs = []
    for leg in surveys.legs:
        line = new_leg()
        line.name, line.parent, line.source = leg.name, leg.parent, leg.tie_on.source.value
        for name in _TIE_ON:
            setattr(line, name, getattr(leg.tie_on, name))
        message.legs.append(line)
    message.remarks = _remark_messages(surveys.remarks, new_remark)
    if surveys.plan is not None:
        planned = surveys.plan
        message.plan.name, message.plan.north = planned.name, planned.north
        message.plan.measured_depth = planned.md.tolist()
        message.plan.inclination = planned.inclination.tolist()
        message.plan.azimuth = planned.azimuth.tolist()
        message.plan.start = planned.positions[0].tolist()
        message.plan.remarks = _remark_messages(planned.remarks, new_remark)


def advice_of(message: Any) -> Advice:
    """Return the Advice of a mwd_msgs/msg/SteeringAdvice."""

    def known(value: float) -> float | None:
        return None if math.isnan(value) else float(value)

    mode = AdviceMode(message.mode)
    return Advice(
        mode=mode,
        toolface=float(message.toolface) if mode == AdviceMode.SLIDE else None,
        magnetic=bool(message.toolface_mode),
        limit=float(message.limit),
        **{name: known(getattr(message, name)) for name in _MAY_BE_UNKNOWN},
        survey=int(message.survey),
        stamp_ns=stamp_of(message.header.stamp),
        source=str(message.source),
        reason=str(message.reason),
    )


def fill_trajectory(message: Any, path: Definitive, stamp_ns: int) -> None:
    """Write a path into an empty mwd_msgs/msg/Trajectory, except for the frame."""
    fill_stamp(message.header.stamp, stamp_ns)
    message.north_reference = int(path.north)
    message.measured_depth = path.md.tolist()
    message.inclination = path.inclination.tolist()
    message.azimuth = path.azimuth.tolist()
    message.north = path.positions[:, 0].tolist()
    message.east = path.positions[:, 1].tolist()
    message.vertical_depth = path.positions[:, 2].tolist()
    message.dogleg_severity = path.dogleg_severity.tolist()
    message.last_is_projected = path.kind[-1] == PROJECTED
    message.first_is_assumed = path.kind[0] == ASSUMED
    message.assumptions = list(sentences(path.assumptions))


def _remarks_of(message: Any) -> tuple[Remark, ...]:
    """Return the remarks of a message."""
    return tuple(
        Remark(RemarkKind(one.kind), str(one.text), dict(zip(one.names, map(float, one.values), strict=True)))
        for one in message.remarks
    )


def _remark_messages(remarks: Iterable[Remark], new_remark: Callable[[], Any]) -> list[Any]:
    messages = []
    for remark in remarks:
        line = new_remark()
        line.kind, line.text = remark.kind.value, remark.text
        line.names, line.values = list(remark.values), list(remark.values.values())
        messages.append(line)
    return messages


def _plain(value: Any) -> Any:
    """Return a scalar unchanged, and an array of the message as a tuple of Python numbers or texts."""
    if isinstance(value, (str, bool, int, float)):
        return value
    items = value.tolist() if hasattr(value, "tolist") else value
    return tuple(items) if isinstance(items, (list, tuple)) else items


def _fill(message: Any, name: str, value: Any) -> None:
    setattr(message, name, list(value) if isinstance(value, tuple) else value)
