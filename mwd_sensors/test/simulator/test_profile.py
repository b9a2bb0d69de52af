# SPDX-License-Identifier: Apache-2.0
"""Profiles: value, rate and acceleration agree; changes are smooth; the last rate goes on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from mwd_sensors.simulator.schedule import ProfileBuilder


def laid():
    lane = ProfileBuilder(5.0, 1.0)
    lane.hold(2.0)
    lane.to_rate(-3.0, 1.5)
    lane.hold(1.0)
    lane.to_rate(0.0, 2.0)
    lane.to_value(40.0, 4.0)
    lane.hold(3.0)
    return lane.build()


def test_the_derivatives_are_those_of_the_value():
    t = np.linspace(0.0, 15.0, 150_001)
    value, rate, acceleration = laid()(t)
    dt = t[1] - t[0]
    assert_allclose(np.gradient(value, dt)[1:-1], rate[1:-1], atol=1e-6)
    assert_allclose(np.gradient(rate, dt)[1:-1], acceleration[1:-1], atol=2e-3)


def test_values_are_reached_exactly_and_kept():
    value, rate, acceleration = laid()(np.array([0.0, 2.0, 10.5, 13.0, 1e6]))
    assert_allclose(value[[0, 1, 2, 4]], [5.0, 7.0, 40.0, 40.0], atol=1e-12)
    assert_allclose(rate[[2, 3, 4]], 0.0, atol=1e-12)
    assert_allclose(acceleration[[1, 2, 3]], 0.0, atol=1e-12)


def test_the_last_rate_goes_on_for_ever_and_the_first_came_from_before():
    lane = ProfileBuilder(1.0, 2.0)
    lane.hold(1.0)
    value, rate, _ = lane.build()(np.array([-0.5, 0.5, 100.0]))
    assert_allclose(value, [0.0, 2.0, 201.0])
    assert_allclose(rate, 2.0)


@given(
    start=st.floats(-50.0, 50.0),
    end=st.floats(-50.0, 50.0),
    seconds=st.floats(0.1, 100.0),
    cut=st.integers(1, 98),
)
def test_a_profile_does_not_care_how_its_times_are_cut(start, end, seconds, cut):
    lane = ProfileBuilder(start)
    lane.hold(0.5)
    lane.to_value(end, seconds)
    lane.to_rate(1.0, seconds)
    profile = lane.build()
    t = np.linspace(0.0, 3.0 * seconds, 100)
    whole, parts = profile(t), np.concatenate([profile(t[:cut]), profile(t[cut:])], axis=1)
    assert np.array_equal(whole, parts)
    between = whole[0][t <= 0.5 + seconds]
    assert between.min() >= min(start, end) - 1e-9
    assert between.max() <= max(start, end) + 1e-9
    assert profile.end == pytest.approx(0.5 + 2.0 * seconds)
