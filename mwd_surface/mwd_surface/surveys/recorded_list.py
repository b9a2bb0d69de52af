# SPDX-License-Identifier: Apache-2.0
"""
The survey list of a recording, as it was kept live: for surveys that are computed again from the same recording.

A survey is the same where its uuid is: that of the same samples at the same time. What changed the list is taken again
in the order in which it happened: decisions of people, depths by hand and revisions of the estimator.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from mwd_surface.bags.bag_reader import Bag
from mwd_surface.surveys.message_conversion import list_of, record_of, stamp_of, survey_of
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, Survey, SurveyRecord
from mwd_surface.surveys.well import Well

EVENTS, EVENT_TYPE = "operator_events", "mwd_msgs/msg/OperatorEvent"
_LIST_TYPE, _SURVEY_TYPE = "mwd_msgs/msg/SurveyList", "mwd_msgs/msg/Survey"
_SET_DEPTH, _ACCEPT, _REJECT = 8, 9, 10  # of OperatorEvent.msg


@dataclasses.dataclass(frozen=True)
class DepthByHand:
    """A bit depth, m, that a person set at a time, ns; log_ns: when it was recorded."""

    log_ns: int
    stamp_ns: int
    bit_depth: float


@dataclasses.dataclass(frozen=True)
class Decided:
    """
    A decision of a person about a survey; measured_depth: depth that it gives, m, -1 for none.

    as_listed: it is known from the list alone, which has the depth whether or not the decision gave it.
    """

    log_ns: int
    uuid: str
    judgement: int
    operator_name: str
    reason: str
    stamp_ns: int
    measured_depth: float = -1.0
    replace: bool = True
    as_listed: bool = False

    def applied(self, surveys: SurveyList, *, depths: bool) -> SurveyList:
        """
        Return the list with this decision; a survey that it does not have changes nothing.

        depths: whether a depth that the decision gives holds, too. Raises ValueError as `SurveyList.accept`.
        """
        found = next((r for r in surveys.records if r.survey.uuid == self.uuid), None)
        if found is None:
            return surveys
        who = (found.survey.sequence, self.operator_name, self.reason, self.stamp_ns)
        if self.judgement == Judgement.REJECTED:
            return surveys.reject(*who)
        known = self.as_listed and self.measured_depth == found.measured_depth
        given = self.measured_depth if depths and not known else -1.0
        return surveys.accept(*who, measured_depth=given, replace=self.replace)


@dataclasses.dataclass(frozen=True)
class Revised:
    """A survey that the estimator judged again."""

    log_ns: int
    survey: Survey


Change = DepthByHand | Decided | Revised


@dataclasses.dataclass(frozen=True)
class RecordedList:
    """
    What a recording tells of its survey list.

    Attributes
    ----------
    first, records : dict of SurveyRecord
        By uuid: as it was listed first, and last.
    changes : tuple of Change
        What changed the list, in the order of recording.
    arrived_ns : dict of int
        When the message of each survey was recorded, ns, by uuid.
    last : SurveyList or None
        The last list, which has legs and plan; None where there is no list.
    without_events : bool
        The recording has the results of a graph, but not its operator events.
    """

    first: Mapping[str, SurveyRecord] = dataclasses.field(default_factory=dict)
    records: Mapping[str, SurveyRecord] = dataclasses.field(default_factory=dict)
    changes: tuple[Change, ...] = ()
    arrived_ns: Mapping[str, int] = dataclasses.field(default_factory=dict)
    last: SurveyList | None = None
    without_events: bool = False

    def before(self, start_ns: int) -> list[SurveyRecord]:
        """Records of surveys taken before a time: of earlier recordings."""
        return [r for r in self.records.values() if r.survey.stamp_ns < start_ns]


def recorded_list(bag: Bag, namespace: str, well: Well) -> RecordedList:
    """
    Return what a recording tells of the survey list of a well; empty where it has no list.

    namespace: of the well, with a slash at its end. well: as the recording describes it.
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
            changes.append(Revised(log_ns, survey_of(decoded)))
        elif name == EVENTS:
            changes += _change_of(log_ns, decoded)
        else:
            message = decoded
            last = {r.survey.uuid: r for r in map(record_of, message.records)}
            for uuid, record in last.items():
                first.setdefault(uuid, record)
                if record.judgement != Judgement.NOT_JUDGED:
                    listed.setdefault((uuid, record.judged_ns), _decision_in(record, log_ns))
    # Without events the decisions are those that the lists show; a rejection first: it makes room for the survey that
    # replaced it at the same time.
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
    """Return what an operator event changed in the list: nothing where it was refused or concerns the estimator."""
    stamp_ns = stamp_of(event.header.stamp)
    if not event.success:
        return []
    if event.kind == _SET_DEPTH:
        return [DepthByHand(log_ns, stamp_ns, float(event.depth))]
    if event.kind not in (_ACCEPT, _REJECT):
        return []
    judgement = Judgement.ACCEPTED if event.kind == _ACCEPT else Judgement.REJECTED
    who = (str(event.operator_name), str(event.reason), stamp_ns)
    return [Decided(log_ns, str(event.uuid), int(judgement), *who, float(event.depth), bool(event.replace))]


def _decision_in(record: SurveyRecord, log_ns: int) -> Decided:
    """Return the decision that a record of a list shows."""
    who = (record.operator_name, record.reason, record.judged_ns)
    return Decided(log_ns, record.survey.uuid, record.judgement, *who, record.measured_depth, as_listed=True)
