# SPDX-License-Identifier: Apache-2.0
"""The pace of a replay: exact over hours, still while paused, and no jump when the rate changes."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.bags.pace import Pace

START = 1_700_000_000_000_000_000
HOUR = 3600 * 10**9


@given(st.floats(0.01, 100), st.integers(0, 100 * HOUR))
def test_a_moment_is_reached_exactly_when_it_is_due(rate, ahead_ns):
    pace = Pace(START, 50.0, rate)
    due = pace.due_s(START + ahead_ns)
    assert due == pytest.approx(50.0 + ahead_ns * 1e-9 / rate, rel=1e-12)
    assert pace.position_ns(due) == pytest.approx(START + ahead_ns, abs=1e4 * max(rate, 1))


@given(st.floats(0.1, 10), st.floats(0.1, 10), st.floats(0, 1e4), st.floats(0, 1e4))
def test_a_change_of_rate_never_moves_the_position(first, second, before_s, after_s):
    pace = Pace(START, 0.0, first)
    here = pace.position_ns(before_s)
    pace.set_rate(second, before_s)
    assert pace.position_ns(before_s) == here
    assert pace.position_ns(before_s + after_s) == pytest.approx(here + after_s * second * 1e9, abs=1e4)


def test_time_stands_still_while_paused_and_goes_on_from_there():
    pace = Pace(START, 10.0)
    pace.pause(12.0)
    assert pace.paused
    assert pace.position_ns(99.0) == START + 2 * 10**9
    assert pace.due_s(START) == math.inf
    pace.resume(100.0)
    assert pace.position_ns(101.0) == START + 3 * 10**9
    assert pace.due_s(START + 2 * 10**9) == pytest.approx(100.0)


@pytest.mark.fault_case(67)
def test_a_seek_goes_backward_too_and_does_not_end_a_pause():
    pace = Pace(START, 10.0)
    pace.pause(12.0)
    pace.seek(START - HOUR, 13.0)
    assert pace.position_ns(500.0) == START - HOUR
    pace.resume(600.0)
    assert pace.due_s(START - HOUR + 10**9) == pytest.approx(601.0)


def test_as_fast_as_possible_everything_is_due_at_once():
    pace = Pace(START, 10.0, math.inf)
    assert pace.due_s(START + 100 * HOUR) == 10.0
    pace.set_rate(2.0, 11.0)
    assert pace.rate == 2.0


@pytest.mark.parametrize("rate", [0.0, -1.0, math.nan])
def test_a_rate_that_is_not_positive_is_refused(rate):
    with pytest.raises(ValueError, match="rate"):
        Pace(START, 0.0, rate)
