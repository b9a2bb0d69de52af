# SPDX-License-Identifier: Apache-2.0
"""The last minutes in constant memory."""

import math

import pytest

from mwd_surface.live.latest_values import StripHistory


def test_a_row_holds_the_mean_or_the_largest_of_its_interval():
    history = StripHistory({"a": "mean", "b": "max"}, seconds=10.0, rate=1.0)
    for now, value in ((5.0, 1.0), (5.5, 3.0), (5.9, 2.0)):
        history.add("a", value, now)
        history.add("b", value, now)
    history.advance(6.0)
    assert history.columns == ("at", "a", "b")
    assert history.rows() == ((6.0, 2.0, 3.0),)


def test_the_largest_of_negative_values_is_not_zero():
    history = StripHistory({"b": "max"})
    history.add("b", -4.0, 1.0)
    history.add("b", -3.0, 1.5)
    history.advance(2.0)
    assert history.rows() == ((2.0, -3.0),)


def test_an_interval_without_data_is_empty_and_not_the_value_before():
    history = StripHistory({"a": "mean"})
    history.add("a", 1.0, 0.5)
    history.advance(2.5)
    assert history.rows() == ((1.0, 1.0), (2.0, None))


@pytest.mark.fault_case(70)
def test_a_long_pause_leaves_one_empty_row_and_memory_stays_bounded():
    history = StripHistory({"a": "mean"}, seconds=60.0, rate=1.0)
    history.add("a", 1.0, 0.5)
    history.advance(1e6)
    assert len(history.rows()) == 2
    for k in range(10_000):
        history.add("a", float(k), 1e6 + k)
    assert len(history.rows()) == 60


def test_what_is_not_finite_or_comes_from_a_clock_that_went_back_is_left_out():
    history = StripHistory({"a": "mean"})
    history.add("a", math.nan, 5.0)
    history.add("a", 2.0, 5.1)
    history.add("a", 9.0, 3.0)
    history.advance(6.0)
    assert history.rows() == ((6.0, 2.0),)


def test_an_unknown_way_to_combine_or_no_room_is_refused_in_words():
    with pytest.raises(ValueError, match="max or angle, got 'sum'"):
        StripHistory({"a": "sum"})
    with pytest.raises(ValueError, match="at least one row"):
        StripHistory({"a": "mean"}, seconds=0.1, rate=1.0)


@pytest.mark.fault_case(38)
def test_an_angle_is_averaged_across_north():
    history = StripHistory({"azimuth": "angle"})
    for k, degrees in enumerate((359.0, 1.0, 3.0)):
        history.add("azimuth", math.radians(degrees), 10.1 + 0.1 * k)
    history.advance(11.0)
    ((_, mean),) = history.rows()
    assert mean == pytest.approx(math.radians(1.0), rel=1e-4)
