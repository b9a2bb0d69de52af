# SPDX-License-Identifier: Apache-2.0
"""Pumps on and off from the pressure alone."""

import math

import numpy as np
import pytest

from mwd_surface.receiver.flow_spans import FlowSpans


def pushed(pressure, block):
    spans = FlowSpans()
    time = np.arange(len(pressure)) / 10.0
    for first in range(0, len(time), block):
        spans.push(time[first : first + block], pressure[first : first + block])
    return spans


def drilled():
    time = np.arange(6000) / 10.0
    on = (time > 40.0) & ~((time > 300.0) & (time < 360.0))
    return np.where(on, 2.0e7, 2.0e5) + 1e5 * np.sin(time)


@pytest.mark.parametrize("block", [1, 7, 100, 6000])
def test_spans_without_flow_are_found_however_the_pressure_is_cut(block):
    spans = pushed(drilled(), block)
    assert [spans.flowing(at) for at in (20.0, 200.0, 330.0, 599.0)] == [False, True, False, True]
    assert [tuple(span) for span in spans.spans] == [
        pytest.approx((0.0, 41.0), abs=1.5),
        pytest.approx((300.0, 360.0), abs=1.5),
    ]
    assert spans.before(200.0) == spans.spans[0]
    assert spans.before(30.0) is None


def test_a_rest_between_two_times_is_told_where_it_is_long_enough_for_a_survey():
    spans = pushed(drilled(), 100)
    assert [spans.rested(*times) for times in ((100.0, 500.0), (100.0, 330.0), (400.0, 599.0))] == [True, False, False]
    spans.switch(700.0, flowing=False)
    spans.switch(708.0, flowing=True)
    assert not spans.rested(690.0, 720.0)


def test_pumps_that_stop_are_known_to_be_off():
    spans = pushed(drilled()[:3200], 50)
    assert spans.flowing(319.0) is False
    assert spans.flowing(200.0) is True
    assert math.isinf(spans.spans[-1].end_s)


def test_before_any_pressure_nothing_is_known():
    assert FlowSpans().flowing(0.0) is None


def test_a_sample_that_is_no_number_does_not_make_standing_mud_flow():
    # What stands in the pipe while the pumps are off is little beside the pressure before, which must be remembered.
    pressure = drilled() + 5.0e5
    with_gap = pressure.copy()
    with_gap[3300] = math.nan
    assert pushed(with_gap, 100).spans == pushed(pressure, 100).spans


def test_a_rest_is_known_however_many_came_after_it():
    # A recording that is decoded at once asks for its first rest when the last one has been found.
    time = np.arange(4000.0)
    spans = FlowSpans()
    spans.push(time, np.where(time % 40.0 < 20.0, 2.0e5, 2.0e7))
    assert spans.rested(-1.0, 30.0)
    assert [spans.flowing(at) for at in (10.0, 30.0)] == [False, True]


def with_gap(begin_s, end_s):
    time = np.arange(6000) / 10.0
    heard = (time < begin_s) | (time > end_s)
    spans = FlowSpans()
    spans.push(time[heard], drilled()[heard])
    return spans


def test_a_data_gap_may_hide_a_rest():
    # A receiver that stood still while the pumps were off: its next survey is not that of the rest before.
    spans = with_gap(250.0, 400.0)
    assert spans.before(240.0) is not None
    assert spans.before(450.0) is None
    assert spans.rested(100.0, 500.0)
    assert not spans.rested(410.0, 500.0)


def test_a_data_gap_that_begins_within_a_rest_may_hide_another():
    spans = with_gap(330.0, 420.0)
    assert spans.before(450.0) is None
    assert spans.on_since(450.0) == pytest.approx(420.0, abs=1.5)
    assert spans.on_since(200.0) == pytest.approx(41.0, abs=1.5)
    assert spans.on_since(20.0) == -math.inf
