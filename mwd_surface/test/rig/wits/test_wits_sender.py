# SPDX-License-Identifier: Apache-2.0
"""When what is sent: surveys once, toolfaces as they come, records by period, keep-alive in silence."""

import dataclasses

import pytest
from example_rig import attitude, values
from example_surveys import START, S, survey, surveys
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_surface.rig.values import nothing_yet
from mwd_surface.rig.wits.format import KEEP_ALIVE, Decoder
from mwd_surface.rig.wits.link import Wits0Schedule, Wits0Sender
from mwd_surface.rig.wits.records import Wits0Format
from mwd_surface.surveys.survey_list import SurveyList


def sender(schedule=None, **form):
    return Wits0Sender(Wits0Format(**form), schedule or Wits0Schedule())


def codes(packet_list):
    return [{i.code for i in f.items} for p in packet_list for f in Decoder().feed(p)]


def depths(packet_list):
    """The depths of the surveys in packets."""
    frames = [f for p in packet_list for f in Decoder().feed(p)]
    return [item.text for f in frames for item in f.items if item.code == 708]


def stamped(seconds):
    return values(sample=attitude(stamp_ns=START + seconds * S))


def test_each_packet_has_one_record_unless_mixed():
    table = values()
    each = codes(sender().due(table, 0.0))
    assert [{c // 100 for c in p} for p in each] == [{7}, {8}, {9}, {1}]
    (together, alive) = codes(sender(mixed=True).due(table, 0.0))
    assert {c // 100 for c in together} == {7, 8, 9}
    assert alive == {111}


def test_a_survey_goes_out_once_when_it_is_accepted_and_again_when_decided_anew():
    s = sender()
    assert not any(713 in p for p in codes(s.due(values(), 0.0)))
    more = surveys().add(survey(13, 44.0, 80.0), 660.0, 0.4)
    assert sum(713 in p for p in codes(s.due(values(more), 1.0))) == 1
    assert not any(713 in p for p in codes(s.due(values(more), 2.0)))
    again = more.accept(9, "Bo", "again", START + 99_000 * S)
    # The decided survey, and after it the last one.
    assert depths(s.due(values(again), 3.0)) == ["540.00", "660.00"]


@given(decisions=st.lists(st.tuples(st.integers(9, 13), st.booleans()), min_size=1, max_size=6))
@settings(max_examples=25, deadline=None)
def test_whatever_people_decide_the_last_survey_that_was_sent_is_the_last_accepted_one(decisions):
    """A recorder kept a survey that a person rejected after it was sent, as the last one."""
    s, whole = sender(), surveys()
    packets = [*s.greeting(values(whole)), *s.due(values(whole), 0.0)]
    whole = whole.add(survey(13, 44.0, 80.0), 660.0, 0.4)
    for k, (number, accepted) in enumerate(decisions):
        at = START + (99_000 + k) * S
        whole = whole.accept(number, "Bo", "", at) if accepted else whole.reject(number, "Bo", "", at)
        table = values(whole)
        packets += s.due(table, float(k + 1))
        last = table.survey
        assert depths(packets)[-1:] == [f"{last.value('measured_depth'):.2f}"]


def test_surveys_are_streamed_only_when_asked_for():
    s = sender(Wits0Schedule(stream_survey=True))
    assert sum(713 in p for k in range(0, 21, 5) for p in codes(s.due(values(), float(k)))) == 5


def test_two_surveys_at_once_are_two_packets_even_mixed():
    s = sender(mixed=True)
    s.due(values(), 0.0)
    more = surveys().add(survey(13, 44.0, 80.0), 660.0, 0.4).add(survey(14, 46.0, 80.0), 690.0, 0.4)
    assert sum(713 in p for p in codes(s.due(values(more), 0.5))) == 2


@pytest.mark.slow
def test_a_toolface_goes_out_when_it_is_new_and_not_more_often_than_its_period():
    s = sender()
    sent = [any(717 in p for p in codes(s.due(stamped(k), float(k)))) for k in range(13)]
    assert [k for k, yes in enumerate(sent) if yes] == [0, 4, 8, 12]
    assert not any(717 in p for p in codes(s.due(stamped(12), 40.0)))


def test_a_toolface_that_is_lost_is_sent_as_a_null_where_nulls_are_sent():
    s = sender(null_text="-9999")
    s.due(values(), 0.0)
    lost = [f for p in s.due(values(later=50.0), 50.0) for f in Decoder().feed(p)]
    assert any(i.code == 717 and i.null for f in lost for i in f.items)


def test_a_keep_alive_goes_out_every_half_minute_even_with_nothing_to_send():
    s = sender()
    empty = nothing_yet()
    alive = [k for k in range(91) if KEEP_ALIVE in s.due(empty, float(k))]
    assert alive == [0, 30, 60, 90]


def test_who_comes_later_is_greeted_with_the_last_accepted_survey_and_the_toolface():
    first, second = codes(sender().greeting(values()))
    assert 713 in first
    assert 717 in second
    assert sender().greeting(values(SurveyList(), later=50.0)) == []


@pytest.mark.parametrize("active", [True, False])
def test_an_inactive_node_sends_no_live_values(active):
    table = values(active=active) if active else dataclasses.replace(values(active=False))
    sent = codes(sender().due(table, 0.0))
    assert any(717 in p for p in sent) is active
