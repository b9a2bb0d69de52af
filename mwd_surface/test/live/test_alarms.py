# SPDX-License-Identifier: Apache-2.0
"""Critical alarms stay until their cause has gone and somebody has acknowledged them; others leave with their cause."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.live.alarm_log import AlarmLog
from mwd_surface.live.alarms import AlarmBook, Severity
from mwd_surface.live.well_clock import WellClock


def raised(book, alarm_id="link.stale", severity=Severity.WARNING, stamp=10, text="no sonde"):
    return book.raise_alarm(alarm_id, severity, text, "check the cable", stamp)


def test_a_critical_alarm_that_clears_by_itself_stays_until_it_is_acknowledged():
    book = AlarmBook()
    _, news = raised(book, severity=Severity.CRITICAL)
    assert news
    assert book.clear("link.stale", 20)
    assert [(a.active, a.acknowledged) for a in book.alarms()] == [(False, False)]
    assert book.acknowledge("link.stale", "A. Berg", 30)[0]
    assert book.alarms() == ()


@pytest.mark.parametrize("severity", [Severity.INFO, Severity.WARNING])
def test_an_alarm_of_lower_priority_leaves_with_its_cause_and_the_log_keeps_it(severity):
    book = AlarmBook()
    raised(book, severity=severity)
    assert book.clear("link.stale", 20)
    assert book.alarms() == ()
    assert [(e.kind, e.source) for e in book.events()] == [("cleared", "link.stale"), ("raised", "link.stale")]


def test_an_acknowledged_alarm_stays_while_its_cause_is_there_and_goes_with_it():
    book = AlarmBook()
    raised(book)
    book.acknowledge("link.stale", "A. Berg", 20)
    assert book.alarms()[0].acknowledged_by == "A. Berg"
    book.clear("link.stale", 30)
    assert book.alarms() == ()


def test_seeing_a_cause_again_is_no_news_but_its_return_is_and_wants_a_new_acknowledgement():
    book = AlarmBook()
    raised(book, severity=Severity.CRITICAL)
    assert raised(book, severity=Severity.CRITICAL, stamp=11)[1] is False
    assert book.alarms()[0].last_ns == 11
    book.clear("link.stale", 12)
    alarm, news = raised(book, severity=Severity.CRITICAL, stamp=13)
    assert news
    assert (alarm.count, alarm.raised_ns, alarm.acknowledged) == (2, 13, False)


def test_an_alarm_that_gets_worse_wants_a_new_acknowledgement():
    book = AlarmBook()
    raised(book)
    book.acknowledge("", "A. Berg", 20)
    alarm, news = raised(book, severity=Severity.CRITICAL, stamp=21)
    assert news
    assert not alarm.acknowledged
    assert book.events()[0].kind == "worse"


def test_nobody_can_acknowledge_without_a_name_or_what_is_not_there():
    book = AlarmBook()
    raised(book)
    assert book.acknowledge("link.stale", "  ", 20) == (
        False,
        "operator_name: must not be empty: the log says who acknowledged",
    )
    ok, message = book.acknowledge("disk", "A. Berg", 20)
    assert not ok
    assert "link.stale" in message
    assert not book.alarms()[0].acknowledged


def test_the_causes_of_one_part_are_raised_and_cleared_together_and_leave_others_alone():
    book = AlarmBook()
    raised(book, "recorder.disk")
    book.sync("link.", {"link.sonde": (2, "no sonde", "check"), "link.rig": (1, "no rig data", "check")}, 20)
    book.sync("link.", {"link.rig": (1, "no rig data", "check")}, 30)
    assert {a.id: a.active for a in book.alarms()} == {"recorder.disk": True, "link.sonde": False, "link.rig": True}
    with pytest.raises(ValueError, match="'disk' does not start with"):
        book.sync("link.", {"disk": (1, "", "")}, 40)


def test_the_log_is_newest_first_and_says_who_and_what():
    book = AlarmBook()
    raised(book)
    book.note("survey", "survey 4 accepted", 15)
    book.acknowledge("", "A. Berg", 20)
    assert [e.kind for e in book.events()] == ["acknowledged", "note", "raised"]
    assert "A. Berg" in book.events()[0].text


@pytest.mark.fault_case(70)
def test_alarms_and_events_are_bounded_and_what_is_refused_is_logged():
    book = AlarmBook(max_alarms=3, max_events=10)
    for k in range(3):
        raised(book, f"a.{k}", stamp=k)
    assert raised(book, "a.new", stamp=5)[1] is False
    assert "3 alarms are active" in book.events()[0].text
    book.clear("a.1", 6)
    assert raised(book, "a.new", stamp=7)[1]
    assert {a.id for a in book.alarms()} == {"a.0", "a.2", "a.new"}
    for k in range(50):
        book.note("x", "y", k)
    assert len(book.events()) == 10


def test_an_empty_id_or_an_unknown_severity_is_a_mistake_of_the_caller():
    with pytest.raises(ValueError, match="alarm_id"):
        raised(AlarmBook(), "")
    with pytest.raises(ValueError, match="7"):
        raised(AlarmBook(), severity=7)


SEVERITIES = {"a": Severity.CRITICAL, "b": Severity.WARNING}
STEPS = st.lists(st.tuples(st.sampled_from(["raise", "clear", "seen"]), st.sampled_from(["a", "b"])), max_size=40)


@given(STEPS)
def test_an_alarm_is_shown_exactly_while_it_is_active_or_critical_and_not_acknowledged(steps):
    book = AlarmBook()
    active, unseen = set(), set()
    for k, (what, alarm_id) in enumerate(steps):
        if what == "raise":
            if alarm_id not in active:
                unseen.add(alarm_id)
            active.add(alarm_id)
            raised(book, alarm_id, SEVERITIES[alarm_id], stamp=k)
        elif what == "clear":
            active.discard(alarm_id)
            book.clear(alarm_id, k)
        else:
            unseen.discard(alarm_id)
            book.acknowledge(alarm_id, "me", k)
        assert {a.id for a in book.alarms()} == active | (unseen & {"a"})


def test_every_change_that_people_see_changes_the_version():
    book = AlarmBook()
    versions = [book.version]
    raised(book)
    versions.append(book.version)
    raised(book, text="no sonde since 04:10")
    versions.append(book.version)
    book.acknowledge("", "A. Berg", 20)
    versions.append(book.version)
    assert len(set(versions)) == 4


@pytest.mark.parametrize("severity", list(Severity))
def test_the_log_of_the_process_has_the_severity_of_the_event_or_alarm(severity):
    logged = []
    log = AlarmLog(WellClock(), lambda text, level: logged.append((text, level)))
    log.log_event("survey", "withdrawn", severity)
    log.raise_alarm("disk.full", severity, "the disk is full", "free some space")
    assert logged == [("survey: withdrawn", severity), ("the disk is full; free some space", severity)]
