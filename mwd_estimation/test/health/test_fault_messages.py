"""Every fault is said in words, with what to do."""

import numpy as np
import pytest

from mwd_estimation.health import axis_consistency as axes
from mwd_estimation.health import fault_debounce as ev
from mwd_estimation.health.fault_messages import finding, known, mistake


@pytest.mark.parametrize("check", range(ev.CHECKS))
def test_every_check_has_words_a_remedy_and_its_end(check):
    details = [ev.ACCEL if check == ev.SIGN else 1, 0, 0]
    found = finding([90, check, ev.FAULT, 40, *details])
    assert found.message
    assert found.remedy
    assert found.sensor
    assert found.severity in ("error", "warning")
    assert 0.0 < found.confidence <= 1.0
    assert (found.since_ns, found.cleared_ns, found.check) == (40, 0, check)
    gone = finding([90, check, ev.OK, 40, *details])
    assert gone.message == f"{found.message} (has ended)"
    assert (gone.remedy, gone.cleared_ns) == ("", 90)


def test_what_must_not_be_used_is_what_the_evidence_says():
    for check in range(ev.CHECKS):
        checks, notes, tally, events = ev.blank()
        for _ in range(9):
            ev.note(notes, check, ev.FOR, 0, 1 if check != ev.SATURATED else ev.ALWAYS, 2, 4)
            ev.weigh(checks, notes, tally, events, 1)
        assert finding(events[0]).unusable == tally[ev.UNUSABLE], check


def test_a_mistake_is_named_by_kind_and_axes():
    names = {mistake(k)[:2] for k in range(1, len(axes.MAPPINGS))}
    assert {("flipped", "x"), ("flipped", "all"), ("swapped", "xy"), ("frame", "yz"), ("frame", "xyz")} <= names
    assert mistake(next(k for k, m in enumerate(axes.MAPPINGS) if np.array_equal(m, np.eye(3)[[0, 2, 1]])))[2] == (
        "y and z exchanged"
    )


def test_explanations_that_remain_share_the_confidence_and_are_all_named():
    one = finding([0, ev.AXES, ev.FAULT, 0, 0, 1 << 1, 0])
    two = finding([0, ev.AXES, ev.FAULT, 0, 1 << 1, 1 << 1, 0])
    assert two.confidence == pytest.approx(one.confidence / 2)
    assert two.sensor == "gyro/accelerometer"
    assert two.unusable == ev.GYRO | ev.ACCEL


def test_what_is_not_yet_known_is_said():
    checks = ev.blank()[0]
    assert set(known(checks).values()) == {"not yet known"}
    # What a string seldom shows is listed once it has.
    assert "y and z of the gyro" not in known(checks)
    checks[ev.CROSS, ev.STATE] = ev.OK
    assert known(checks)["y and z of the gyro"] == "ok"


def test_a_force_without_gravity_is_said_with_both_figures():
    none = finding([0, ev.LENGTH, ev.FAULT, 0, 180, 981, 0])
    assert none.message == "accelerometer reads no gravity: the mean force is 1.8 m/s^2, expected 9.8"
    assert "more than gravity" in finding([0, ev.LENGTH, ev.FAULT, 0, 1962, 981, 0]).message
    assert "noise of 90 m/s^2" in finding([0, ev.LENGTH, ev.FAULT, 0, 9000, 981, 1]).message
    assert (none.kind, none.unusable) == ("gravity", ev.ACCEL)
