# SPDX-License-Identifier: Apache-2.0
"""
The survey list that was kept live, read from a recording in which the surveys are computed again.

Surveys with the same uuid are the same survey: they come from the same samples at the same time. Changes of the list
are applied again in their original order: decisions of people, depths by hand and revisions of the estimator.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from mwd_estimation.survey.survey import Survey
from mwd_sensors.core.message_record import stamp_of
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.surveys.message_conversion import list_of, record_of
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord, Value
from mwd_surface.surveys.well import Well

EVENTS, EVENT_TYPE = "operator_events", "mwd_msgs/msg/OperatorEvent"
_LIST_TYPE, _SURVEY_TYPE = "mwd_msgs/msg/SurveyList", "mwd_msgs/msg/Survey"
_SET_DEPTH, _ACCEPT, _REJECT = 8, 9, 10  # kinds of OperatorEvent.msg


@dataclasses.dataclass(frozen=True)
class DepthByHand:
    """Bit depth, m, set by a person at `stamp_ns`."""

    log_ns: int  #: time at which the message was recorded
    stamp_ns: int
    bit_depth: float


@dataclasses.dataclass(frozen=True)
class Decided:
    """Decision about a survey that a person made at `stamp_ns`."""

    log_ns: int  #: time at which the message was recorded
    uuid: str
    judgement: int
    operator_name: str
    reason: str
    stamp_ns: int
    measured_depth: float = math.nan  #: depth given with the decision, m; NaN if none was given
    #: `replace`, `value`: as in `SurveyList.accept`.
    replace: bool = True
    value: int = int(Value.DEFINITIVE)
    #: Whether the decision comes from a recorded survey list, because the recording has no operator events. Then
    #: `measured_depth` is the depth of the survey in that list, which the person may not have entered.
    as_listed: bool = False

    def applied(self, surveys: SurveyList, *, depths: bool) -> SurveyList:
        """
        Return the list with this decision applied; unchanged if the survey is not in the list.

        depths: whether to apply a depth given with the decision. Raises ValueError like `SurveyList.accept`.
        """
        found = next((r for r in surveys.records if r.survey.uuid == self.uuid), None)
        if found is None:
            return surveys
        who = (found.survey.sequence, self.operator_name, self.reason, self.stamp_ns)
        if self.judgement == Judgement.REJECTED:
            return surveys.reject(*who)
        known = self.as_listed and self.measured_depth == found.measured_depth
        given = self.measured_depth if depths and not known else math.nan
        return surveys.accept(*who, measured_depth=given, replace=self.replace, value=Value(self.value))


@dataclasses.dataclass(frozen=True)
class Revised:
    """New result of the estimator for a survey."""

    log_ns: int  #: time at which the message was recorded
    survey: Survey


Change = DepthByHand | Decided | Revised


@dataclasses.dataclass(frozen=True)
class RecordedList:
    """Information in the survey lists of a recording."""

    #: `first`, `records`: record of each survey by uuid: in the first list that has the survey, and in the last list of
    #: the recording.
    first: Mapping[str, SurveyRecord] = dataclasses.field(default_factory=dict)
    records: Mapping[str, SurveyRecord] = dataclasses.field(default_factory=dict)
    changes: tuple[Change, ...] = ()  #: changes of the list, in the order of recording
    #: Time at which the message of each survey was recorded, by uuid.
    arrived_ns: Mapping[str, int] = dataclasses.field(default_factory=dict)
    last: SurveyList | None = None  #: last list, with legs and plan; None if there is no list
    #: Whether operator events are missing: the recording has survey lists but neither operator events nor used samples,
    #: or it has live surveys but no survey list.
    without_events: bool = False

    def before(self, start_ns: int) -> list[SurveyRecord]:
        """Return the records of surveys that were taken before the start of the recording, `start_ns`, ns."""
        return [r for r in self.records.values() if r.survey.stamp_ns < start_ns]


def recorded_list(bag: Bag, namespace: str, well: Well) -> RecordedList:
    """
    Return the information in the survey lists of a well in a recording; without a list only `without_events` is set.

    namespace: namespace of the well, ending with a slash. well: well as described by the recording.
    """
    types = {
        "surveys": _LIST_TYPE,
        EVENTS: EVENT_TYPE,
        "survey": _SURVEY_TYPE,
        "survey/revised": _SURVEY_TYPE,
    }
    names = {f"{namespace}{name}": name for name, kind in types.items() if _has(bag, f"{namespace}{name}", kind)}
    if f"{namespace}surveys" not in names:
        return RecordedList(without_events=f"{namespace}survey" in names)
    first: dict[str, SurveyRecord] = {}
    last: dict[str, SurveyRecord] = {}
    message = None
    changes: list[Change] = []
    arrived: dict[str, int] = {}
    listed: dict[tuple[str, int], Decided] = {}
    for log_ns, topic, _, data in bag.messages(list(names)):
        decoded = bag.decode(topic, data)
        name = names[topic]
        if name == "survey":
            arrived.setdefault(str(decoded.uuid), log_ns)
        elif name == "survey/revised":
            changes.append(Revised(log_ns, Survey.from_message(decoded)))
        elif name == EVENTS:
            changes += _change_of(log_ns, decoded)
        else:
            message = decoded
            last = {r.survey.uuid: r for r in map(record_of, message.records)}
            for uuid, record in last.items():
                first.setdefault(uuid, record)
                if record.judgement != Judgement.NOT_JUDGED:
                    listed.setdefault((uuid, record.judged_ns), _decision_in(record, log_ns))
    # Without events, take the decisions from the lists; rejections first, to make room for the survey that replaced the
    # rejected one at the same time.
    with_events = f"{namespace}{EVENTS}" in names or _has(bag, f"{namespace}used_samples", "mwd_msgs/msg/UsedSamples")
    if not with_events:
        changes = sorted([*changes, *sorted(listed.values(), key=_rejections_first)], key=lambda one: one.log_ns)
    return RecordedList(
        first, last, tuple(changes), arrived, None if message is None else list_of(message, well), not with_events
    )


def _rejections_first(decided: Decided) -> tuple[int, bool]:
    return decided.log_ns, decided.judgement != Judgement.REJECTED


def _has(bag: Bag, name: str, type_name: str) -> bool:
    about = bag.topics.get(name)
    return about is not None and about.type_name == type_name


def _change_of(log_ns: int, event: Any) -> list[Change]:
    """Return the one change of the list by an operator event; empty if the event failed or does not change the list."""
    stamp_ns = stamp_of(event.header.stamp)
    if not event.success:
        return []
    if event.kind == _SET_DEPTH:
        return [DepthByHand(log_ns, stamp_ns, float(event.depth))]
    if event.kind not in (_ACCEPT, _REJECT):
        return []
    judgement = Judgement.ACCEPTED if event.kind == _ACCEPT else Judgement.REJECTED
    who = (str(event.operator_name), str(event.reason), stamp_ns)
    given = (float(event.depth), bool(event.replace), int(event.value))
    return [Decided(log_ns, str(event.uuid), int(judgement), *who, *given)]


def _decision_in(record: SurveyRecord, log_ns: int) -> Decided:
    """Return the last decision on a survey, from its record in a survey list."""
    who = (record.operator_name, record.reason, record.judged_ns)
    return Decided(log_ns, record.survey.uuid, record.judgement, *who, record.measured_depth, as_listed=True)
