# SPDX-License-Identifier: Apache-2.0
"""Debouncing of faults: observations in a row make a fault and end it; a doubt passes."""

from __future__ import annotations

import numpy as np
import pytest

from mwd_estimation.core.sensor_fault import ACCEL, GYRO, MAG, PRECISION, FaultCode, FaultUnit
from mwd_estimation.health import fault_debounce as debounce
from mwd_estimation.health.fault_debounce import AGAINST, FAULT, FOR, NOTHING, OK, RULES, STRONGLY

SENSOR_BITS = {0: GYRO, 3: ACCEL, 6: MAG}


def seen(checks, code, place, observations, which=(0, 0, 0)):
    """Changes and states after each observation, the k-th at k seconds."""
    changes, states = [], []
    for k, one in enumerate(observations):
        check = checks[code, place]
        debounce.observe(check, one, k * 10**9, 1.0, 2.0)
        check.seen_which[:] = which
        debounce.weigh(checks)
        changes += debounce.take_changes(checks, (k + 1) * 10**9)
        states.append(int(checks[code, place].state))
    return changes, states


def test_a_code_without_a_rule_is_named():
    rules = {code: rule for code, rule in RULES.items() if code != FaultCode.MOUNT}
    with pytest.raises(ValueError, match="no row for MOUNT"):
        debounce._in_order(rules)


@pytest.mark.parametrize("code", list(FaultCode))
def test_a_fault_needs_its_observations_in_a_row_and_goes_after_enough_against_it(code):
    rule = RULES[code]
    checks = debounce.blank()
    changes, states = seen(checks, code, 3, [FOR] * rule.need + [AGAINST] * rule.clear)
    assert states[: rule.need] == [0] * (rule.need - 1) + [FAULT]
    assert states[-1] == OK
    assert [bool(one.cleared_ns) for one in changes] == [False, True]
    assert {(one.code, one.place, one.since_ns, one.value, one.limit) for one in changes} == {(code, 3, 0, 1.0, 2.0)}
    assert len({one.check for one in changes}) == 1


def test_one_observation_against_it_begins_the_count_anew_but_for_a_patient_check():
    assert seen(debounce.blank(), FaultCode.INVALID, 0, [FOR, AGAINST, FOR])[1] == [0, OK, OK]
    patient = seen(debounce.blank(), FaultCode.CLIPPED, 0, [FOR, AGAINST] * 4)[1]
    assert patient[6] == FAULT


def test_nothing_seen_neither_counts_nor_begins_anew_and_strong_evidence_counts_twice():
    assert seen(debounce.blank(), FaultCode.INVALID, 0, [FOR, NOTHING, FOR])[1][-1] == FAULT
    assert seen(debounce.blank(), FaultCode.GRAVITY, 3, [STRONGLY, STRONGLY])[1] == [0, FAULT]


def test_axes_that_are_narrowed_down_are_reported_again():
    checks = debounce.blank()
    seen(checks, FaultCode.AXES, 0, [FOR, FOR], (0b110, 0, 0))
    changes, _ = seen(checks, FaultCode.AXES, 0, [FOR, FOR], (0b100, 0, 0))
    assert [one.which for one in changes] == [(0b100, 0, 0)]


@pytest.mark.parametrize("place", SENSOR_BITS)
def test_a_fault_accuses_its_sensor_and_of_a_second_unit_the_unit(place):
    checks = debounce.blank()
    seen(checks, FaultCode.DEAD, place, [FOR] * 6)
    assert debounce.unusable(checks) == SENSOR_BITS[place]
    assert [one.unusable for one in debounce.standing(checks)] == [SENSOR_BITS[place]]
    assert [one.unusable for one in debounce.standing(checks, FaultUnit.PRECISION)] == [PRECISION]


def test_a_fault_between_sensors_accuses_those_of_its_own_data():
    checks = debounce.blank()
    seen(checks, FaultCode.AXES, 0, [FOR, FOR], (0, 8, 8))
    assert debounce.unusable(checks) == ACCEL | MAG
    many = debounce.blank()
    seen(many, FaultCode.FRAME, 3, [FOR, FOR], (0, 0b111, 0b11))
    assert debounce.unusable(many) == MAG


def test_what_is_not_counted_yet_raises_a_suspicion_and_a_doubt_lasts_and_passes():
    checks = debounce.blank()
    debounce.observe(checks[FaultCode.STUCK, 4], FOR, 0, 0.0, 0.0)
    assert debounce.suspected(checks) == ACCEL
    left = np.zeros(3, dtype=np.int64)
    doubts = [debounce.doubt(left, ACCEL if k == 0 else 0) for k in range(debounce.DOUBT_BINS + 1)]
    assert doubts == [ACCEL] * debounce.DOUBT_BINS + [0]
