# SPDX-License-Identifier: Apache-2.0
"""Critical alarms stay until their cause has gone and somebody has acknowledged them; others leave with their cause."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.live import alarms
from mwd_surface.live.alarms import AlarmLog, Severity


class Log(AlarmLog):
    """An alarm log whose clock the test sets: `log.at(stamp)`."""

    def __init__(self):
        super().__init__(lambda: self.stamp)
        self.stamp = 0

    def at(self, stamp):
        self.stamp = stamp
        return self


def raised(log, alarm_id="link.stale", severity=Severity.WARNING, stamp=10, text="no sonde"):
    log.at(stamp).raise_alarm(alarm_id, severity, text, "check the cable")


def test_the_log_keeps_what_has_left_newest_first_and_says_who_and_what():
    log = Log()
    raised(log)
    log.at(15).log_event("survey", "survey 4 accepted")
    log.at(20).acknowledge("", "A. Berg")
    assert log.alarms()[0].acknowledged_by == "A. Berg"
    log.at(30).clear_alarm("link.stale")
    assert log.alarms() == ()
    assert [e.kind for e in log.events()] == ["cleared", "acknowledged", "note", "raised"]
    assert "A. Berg" in log.events()[1].text


def test_seeing_a_cause_again_is_no_news_but_its_return_is_and_wants_a_new_acknowledgement():
    log = Log()
    raised(log, severity=Severity.CRITICAL)
    raised(log, severity=Severity.CRITICAL, stamp=11)
    assert log.alarms()[0].last_ns == 11
    assert len(log.events()) == 1
    log.at(12).clear_alarm("link.stale")
    raised(log, severity=Severity.CRITICAL, stamp=13)
    (alarm,) = log.alarms()
    assert (alarm.count, alarm.raised_ns, alarm.acknowledged) == (2, 13, False)


def test_an_alarm_that_gets_worse_wants_a_new_acknowledgement():
    log = Log()
    raised(log)
    log.at(20).acknowledge("", "A. Berg")
    raised(log, severity=Severity.CRITICAL, stamp=21)
    assert not log.alarms()[0].acknowledged
    assert log.events()[0].kind == "worse"


def test_nobody_can_acknowledge_without_a_name_or_what_is_not_there():
    log = Log()
    raised(log)
    for alarm_id, name, word in (("link.stale", "  ", "operator_name"), ("disk", "A. Berg", "link.stale")):
        done, message = log.at(20).acknowledge(alarm_id, name)
        assert not done
        assert word in message
    assert not log.alarms()[0].acknowledged


def test_the_causes_of_one_part_are_raised_and_cleared_together_and_leave_others_alone():
    log = Log()
    raised(log, "recorder.disk")
    log.at(20).set_alarms("link.", {"link.sonde": (2, "no sonde", "check"), "link.rig": (1, "no rig data", "check")})
    log.at(30).set_alarms("link.", {"link.rig": (1, "no rig data", "check")})
    assert {a.id: a.active for a in log.alarms()} == {"recorder.disk": True, "link.sonde": False, "link.rig": True}
    with pytest.raises(ValueError, match="'disk' does not start with"):
        log.at(40).set_alarms("link.", {"disk": (1, "", "")})


@pytest.mark.fault_case(70)
def test_alarms_and_events_are_bounded_and_what_is_refused_is_logged(monkeypatch):
    monkeypatch.setattr(alarms, "_MAX_ALARMS", 3)
    monkeypatch.setattr(alarms, "_MAX_EVENTS", 10)
    log = Log()
    for k in range(3):
        raised(log, f"a.{k}", stamp=k)
    raised(log, "a.new", stamp=5)
    assert "3 alarms are active" in log.events()[0].text
    log.at(6).clear_alarm("a.1")
    raised(log, "a.new", stamp=7)
    assert {a.id for a in log.alarms()} == {"a.0", "a.2", "a.new"}
    for k in range(50):
        log.at(k).log_event("x", "y")
    assert len(log.events()) == 10


SEVERITIES = {"a": Severity.CRITICAL, "b": Severity.WARNING, "c": Severity.INFO}
STEPS = st.lists(st.tuples(st.sampled_from(["raise", "clear", "seen"]), st.sampled_from("abc")), max_size=40)


@given(STEPS)
def test_an_alarm_is_shown_exactly_while_it_is_active_or_critical_and_not_acknowledged(steps):
    """A critical alarm whose cause has gone stays until it is acknowledged; any other leaves with its cause."""
    log = Log()
    active, unseen = set(), set()
    for k, (what, alarm_id) in enumerate(steps):
        if what == "raise":
            if alarm_id not in active:
                unseen.add(alarm_id)
            active.add(alarm_id)
            raised(log, alarm_id, SEVERITIES[alarm_id], stamp=k)
        elif what == "clear":
            active.discard(alarm_id)
            log.at(k).clear_alarm(alarm_id)
        else:
            unseen.discard(alarm_id)
            log.at(k).acknowledge(alarm_id, "me")
        assert {a.id: a.active for a in log.alarms()} == {one: one in active for one in active | (unseen & {"a"})}
        assert all(a.acknowledged == (a.id not in unseen) for a in log.alarms())


def test_every_change_that_people_see_changes_the_version():
    log = Log()
    versions = {log.version}
    for change in (
        lambda: raised(log),
        lambda: raised(log, text="no sonde since 04:10"),
        lambda: log.at(20).acknowledge("", "A. Berg"),
    ):
        change()
        assert log.version not in versions
        versions.add(log.version)


@pytest.mark.parametrize("severity", list(Severity))
def test_the_log_of_the_process_has_the_severity_of_the_event_or_alarm(severity):
    logged = []
    log = AlarmLog(lambda: 1, lambda text, level: logged.append((text, level)))
    log.log_event("survey", "withdrawn", severity)
    log.raise_alarm("disk.full", severity, "the disk is full", "free some space")
    assert logged == [("survey: withdrawn", severity), ("the disk is full; free some space", severity)]


CAUSES = st.dictionaries(st.sampled_from(["a.1", "a.2"]), st.sampled_from([1, 2]))


@given(st.lists(st.one_of(CAUSES, st.tuples(st.sampled_from(["a.1", "a.3"]), st.sampled_from([0, 1, 2]))), max_size=20))
def test_the_log_of_the_process_has_each_alarm_once_however_it_is_raised(steps):
    logged = []
    log = AlarmLog(lambda: 1, lambda text, level: logged.append((text, level)))
    for step in steps:
        if isinstance(step, dict):
            log.set_alarms("a.", {alarm_id: (severity, alarm_id, "") for alarm_id, severity in step.items()})
        else:
            log.raise_alarm(*step, step[0])
    begun = [(e.source, e.severity) for e in reversed(log.events()) if e.kind in ("raised", "worse")]
    assert logged == begun
