# SPDX-License-Identifier: Apache-2.0
"""
Conversion between ROS messages and the survey list with its path; `SurveyRecord` converts itself.

No ROS code is imported: a message is any object with the fields of its .msg file, and `make` creates a message from its
type name and field values. Both sides hold the same SI numbers (`mwd_sensors.core.message_record`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

from mwd_sensors.core.message_record import HEADER, Make, stamp_of, time_message
from mwd_surface.list_files.remark import Remark, RemarkKind, sentences
from mwd_surface.surveys.leg import Leg, Origin, TieOn
from mwd_surface.surveys.list_rules import ListRules
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, SurveyDecisionRecord, SurveyRecord
from mwd_surface.surveys.well import Well
from mwd_surface.trajectory.plan import Plan, plan_of
from mwd_surface.trajectory.well_path import ASSUMED, PROJECTED, Definitive

# Numbers of a tie-on, with the same names in Leg.msg and `TieOn`.
_TIE_ON = ("measured_depth", "inclination", "azimuth", "north", "east", "vertical_depth")


def record_of(message: Any) -> SurveyRecord:
    """Return the SurveyRecord of a mwd_msgs/msg/SurveyRecord; the message holds only the last decision."""
    record = SurveyRecord.from_message(message)
    if record.judgement == Judgement.NOT_JUDGED:
        return record
    last = SurveyDecisionRecord(
        record.judgement, record.operator_name, record.reason, record.judged_ns, record.measured_depth
    )
    return dataclasses.replace(record, decisions=(last,))


def list_of(message: Any, well: Well, rules: ListRules | None = None) -> SurveyList:
    """
    Return the SurveyList of a mwd_msgs/msg/SurveyList; well and rules are given, because the message has none.

    Raises
    ------
    ValueError
        A value of the message is not valid, or the path through its stations cannot be computed.
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


def list_message(surveys: SurveyList, frame_id: str, make: Make) -> Any:
    """Return a survey list as a mwd_msgs/msg/SurveyList."""
    legs = [
        {"name": leg.name, "parent": leg.parent, "source": leg.tie_on.source.value}
        | {name: getattr(leg.tie_on, name) for name in _TIE_ON}
        for leg in surveys.legs
    ]
    planned = surveys.plan
    plan: dict[str, Any] = {}
    if planned is not None:
        plan = {
            "name": planned.name,
            "north": planned.north,
            "measured_depth": planned.md.tolist(),
            "inclination": planned.inclination.tolist(),
            "azimuth": planned.azimuth.tolist(),
            "start": planned.positions[0].tolist(),
            "remarks": _remark_messages(planned.remarks, make),
        }
    return make(
        "mwd_msgs/msg/SurveyList",
        {
            "header": _header(surveys.changed_ns, frame_id, make),
            "well": surveys.well.name,
            "records": [record.to_message(make) for record in surveys.records],
            "leg": surveys.leg,
            "legs": [make("mwd_msgs/msg/Leg", leg) for leg in legs],
            "plan": make("mwd_msgs/msg/Plan", plan),
            "remarks": _remark_messages(surveys.remarks, make),
        },
    )


def trajectory_message(path: Definitive, stamp_ns: int, frame_id: str, make: Make) -> Any:
    """Return a path as a mwd_msgs/msg/Trajectory."""
    return make(
        "mwd_msgs/msg/Trajectory",
        {
            "header": _header(stamp_ns, frame_id, make),
            "north_reference": int(path.north),
            "measured_depth": path.md.tolist(),
            "inclination": path.inclination.tolist(),
            "azimuth": path.azimuth.tolist(),
            "north": path.positions[:, 0].tolist(),
            "east": path.positions[:, 1].tolist(),
            "vertical_depth": path.positions[:, 2].tolist(),
            "dogleg_severity": path.dogleg_severity.tolist(),
            "last_is_projected": bool(path.kind[-1] == PROJECTED),
            "first_is_assumed": bool(path.kind[0] == ASSUMED),
            "assumptions": list(sentences(path.assumptions)),
        },
    )


def _header(stamp_ns: int, frame_id: str, make: Make) -> Any:
    return make(HEADER, {"stamp": time_message(stamp_ns, make), "frame_id": frame_id})


def _remarks_of(message: Any) -> tuple[Remark, ...]:
    """Return the remarks of a message."""
    return tuple(
        Remark(RemarkKind(one.kind), str(one.text), dict(zip(one.names, map(float, one.values), strict=True)))
        for one in message.remarks
    )


def _remark_messages(remarks: Iterable[Remark], make: Make) -> list[Any]:
    return [
        make(
            "mwd_msgs/msg/Remark",
            {
                "kind": one.kind.value,
                "text": one.text,
                "names": list(one.values),
                "values": list(one.values.values()),
            },
        )
        for one in remarks
    ]
