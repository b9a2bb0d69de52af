"""
The survey list of a recording, as it was kept live: for surveys that are computed again from the same recording.

A survey is the same where its uuid is: that of the same samples at the same time.
"""

from __future__ import annotations

import dataclasses

from mwd_surface.bags.bag_reader import Bag
from mwd_surface.surveys.message_conversion import record_of
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.survey_record import Judgement, SurveyRecord

LIST_TYPE = "mwd_msgs/msg/SurveyList"


@dataclasses.dataclass(frozen=True)
class RecordedList:
    """Records of the last survey list of a recording, by uuid."""

    records: dict[str, SurveyRecord] = dataclasses.field(default_factory=dict)

    def before(self, start_ns: int) -> list[SurveyRecord]:
        """Records of surveys taken before a time: of earlier recordings."""
        return [r for r in self.records.values() if r.survey.stamp_ns < start_ns]

    def decided(self, surveys: SurveyList) -> tuple[SurveyList, tuple[str, ...]]:
        """
        Return a list with the decisions that people took, in their order, and what could not be decided again.

        Of surveys that are not in the list nothing is decided.
        """
        known = {r.survey.uuid: r.survey.sequence for r in surveys.records}
        judged = [r for r in self.records.values() if r.judgement != Judgement.NOT_JUDGED and r.survey.uuid in known]
        failed = []
        # A rejection first: it may make room for the survey that replaced it.
        for record in sorted(judged, key=lambda r: (r.judged_ns, r.judgement != Judgement.REJECTED)):
            who = (known[record.survey.uuid], record.operator_name, record.reason, record.judged_ns)
            try:
                if record.judgement == Judgement.REJECTED:
                    surveys = surveys.reject(*who)
                else:
                    surveys = surveys.accept(*who, replace=True)
            except ValueError as error:
                failed.append(f"the decision of {record.operator_name} is not taken over: {error}")
        for record in judged:
            number = known[record.survey.uuid]
            # A comment may tell of a depth given by hand, which another depth has replaced.
            if surveys.find(number).measured_depth == record.measured_depth:
                surveys = surveys.remark(number, record.comment)
        return surveys, tuple(failed)


def recorded_list(bag: Bag, namespace: str) -> RecordedList:
    """
    Return the last survey list of a well in a recording; empty where there is none.

    namespace: of the well, with a slash at its end.
    """
    about = bag.topics.get(f"{namespace}surveys")
    if about is None or about.type_name != LIST_TYPE:
        return RecordedList()
    last = None
    for _, _, _, data in bag.messages([about.name]):
        last = data
    if last is None:
        return RecordedList()
    records = [record_of(record) for record in bag.decode(about.name, last).records]
    return RecordedList({r.survey.uuid: r for r in records})
