# SPDX-License-Identifier: Apache-2.0
"""
The survey list of a recording, as it was kept live: for surveys that are computed again from the same recording.

A survey is the same where its uuid is: that of the same samples at the same time.
"""

from __future__ import annotations

import dataclasses
import math

from mwd_surface.bags.bag_reader import Bag
from mwd_surface.surveys.message_conversion import list_of, record_of
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord
from mwd_surface.surveys.well import Well

LIST_TYPE = "mwd_msgs/msg/SurveyList"


@dataclasses.dataclass(frozen=True)
class RecordedList:
    """
    What the survey lists of a recording tell of each survey.

    Attributes
    ----------
    first, records : dict of SurveyRecord
        By uuid: as it was listed first, and last.
    judged : tuple of SurveyRecord
        As it was after each decision of a person, in order.
    last : SurveyList or None
        The last list, which has legs and plan; None where there is no list.
    """

    first: dict[str, SurveyRecord] = dataclasses.field(default_factory=dict)
    records: dict[str, SurveyRecord] = dataclasses.field(default_factory=dict)
    judged: tuple[SurveyRecord, ...] = ()
    last: SurveyList | None = None

    def before(self, start_ns: int) -> list[SurveyRecord]:
        """Records of surveys taken before a time: of earlier recordings."""
        return [r for r in self.records.values() if r.survey.stamp_ns < start_ns]

    def decided(self, surveys: SurveyList, *, depths: bool) -> tuple[SurveyList, tuple[str, ...]]:
        """
        Return a list with its revisions and the decisions of people, in order, and what could not be decided again.

        Of surveys that are not in the list nothing is decided. depths: whether depths they gave hold, too.
        """
        known = {r.survey.uuid: r.survey.sequence for r in surveys.records}
        failed = []
        for record in self.records.values():
            for revised in record.revised:
                surveys = surveys.revise(revised)
        for record in self.judged:
            number = known.get(record.survey.uuid)
            if number is None:
                continue
            who = (number, record.operator_name, record.reason, record.judged_ns)
            given = record.measured_depth if depths else surveys.find(number).measured_depth
            md = math.nan if given == surveys.find(number).measured_depth else given
            try:
                if record.judgement == Judgement.REJECTED:
                    surveys = surveys.reject(*who)
                else:
                    surveys = surveys.accept(*who, measured_depth=md, replace=True)
            except ValueError as error:
                failed.append(f"the decision of {record.operator_name} is not taken over: {error}")
        return surveys, tuple(failed)


def recorded_list(bag: Bag, namespace: str, well: Well) -> RecordedList:
    """
    Return what the survey lists of a well in a recording tell; empty where there is none.

    namespace: of the well, with a slash at its end. well: as the recording describes it.
    """
    about = bag.topics.get(f"{namespace}surveys")
    if about is None or about.type_name != LIST_TYPE:
        return RecordedList()
    first: dict[str, SurveyRecord] = {}
    last: dict[str, SurveyRecord] = {}
    message = None
    judged: dict[tuple[str, int], SurveyRecord] = {}
    for _, _, _, data in bag.messages([about.name]):
        message = bag.decode(about.name, data)
        last = {r.survey.uuid: r for r in map(record_of, message.records)}
        for uuid, record in last.items():
            first.setdefault(uuid, record)
            if record.judgement != Judgement.NOT_JUDGED:
                judged.setdefault((uuid, record.judged_ns), record)
    # A rejection first: it makes room for the survey that replaced it at the same time.
    order = sorted(judged.values(), key=lambda r: (r.judged_ns, r.judgement != Judgement.REJECTED))
    return RecordedList(first, last, tuple(order), None if message is None else list_of(message, well))
