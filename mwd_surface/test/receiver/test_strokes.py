# SPDX-License-Identifier: Apache-2.0
"""Strokes of a counter: crank angles that turn with the pump, and none where it stands."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.receiver.grid import Strokes

TIME = np.linspace(10.0, 40.0, 301)


def counted(*times):
    strokes = Strokes()
    for pump, one in enumerate(times, 1):
        strokes.add(pump, one)
    return strokes


def test_the_angle_turns_once_a_stroke():
    even, slow = np.arange(0.0, 60.0, 0.7), np.arange(0.0, 60.0, 1.1)
    angles = counted(even, slow).angles(TIME)
    assert angles.shape == (2, len(TIME))
    assert np.diff(angles[0]) == pytest.approx(2.0 * np.pi * 0.1 / 0.7)
    assert np.diff(angles[1]) == pytest.approx(2.0 * np.pi * 0.1 / 1.1)


def test_a_pump_that_stands_has_no_angle():
    times = np.concatenate([np.arange(0.0, 20.0, 0.7), np.arange(30.0, 60.0, 0.7)])
    angle = counted(times).angles(TIME)[0]
    assert np.isnan(angle[(TIME > 21.0) & (TIME < 29.0)]).all()
    assert np.isfinite(angle[TIME < 19.0]).all()
    assert counted(times[:4]).angles(TIME).shape == (0, len(TIME))


@pytest.mark.parametrize("jitter", [0.0005, 0.004, 0.02])
def test_jitter_is_averaged_and_strokes_missed_in_a_row_leave_no_hole(jitter):
    """The rate hunts by 0.2 % within 12 s; the angle is compared with that of the pump itself."""
    random = np.random.default_rng(3)
    rate = 1.45 * (1.0 + 0.002 * np.sin(2.0 * np.pi * TIME / 12.0))
    turns = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(TIME))])
    strokes = np.interp(np.arange(1, int(turns[-1])), turns, TIME)
    strokes = strokes + random.normal(0.0, jitter, len(strokes))
    seen = np.delete(strokes, [7, 15, 16, 17, 30])
    angle = counted(seen).angles(TIME)[0]
    inside = (seen[0] < TIME) & (seen[-1] > TIME)
    assert np.isfinite(angle[inside]).all()
    error = (angle - 2.0 * np.pi * turns)[inside]
    assert np.std(error) < 0.75 * 2.0 * np.pi * 1.45 * jitter + 0.003


def test_a_line_is_the_harmonic_of_the_nearest_pump():
    strokes = counted(np.arange(0.0, 60.0, 1.0 / 1.45), np.arange(0.0, 60.0, 1.0 / 1.335))
    assert strokes.harmonic(3 * 1.335 + 0.002, 0.0, 60.0) == (2, 3)
    assert strokes.harmonic(3 * 1.45 - 0.002, 0.0, 60.0) == (1, 3)
    assert strokes.harmonic(4.18, 0.0, 60.0) is None
    assert counted().harmonic(4.0, 0.0, 60.0) is None


def test_a_line_that_no_pump_makes_is_seldom_taken_for_a_harmonic():
    random = np.random.default_rng(8)
    named = 0
    for _ in range(1000):
        strokes = counted(*(np.arange(0.0, 17.0, 1.0 / rate) for rate in random.uniform(0.8, 2.0, 3)))
        named += strokes.harmonic(random.uniform(7.0, 17.0), 0.0, 17.0) is not None
    assert named < 0.05 * 1000 + 3.0 * np.sqrt(0.05 * 1000)


def test_later_strokes_change_nothing():
    times = np.arange(0.0, 60.0, 0.7)
    early = counted(times[times <= TIME[-1]])
    assert np.array_equal(early.angles(TIME), counted(times).angles(TIME))
    early.forget(9.0)
    assert np.diff(early.angles(TIME)[0]) == pytest.approx(np.diff(counted(times).angles(TIME)[0]))


def test_known_times_are_left_out():
    times = np.arange(0.0, 60.0, 0.7)
    twice = counted(np.repeat(times, 2))
    twice.add(1, times[:5])
    assert np.array_equal(twice.angles(TIME), counted(times).angles(TIME))


def test_rates_are_those_of_the_time_asked_for():
    strokes = counted(np.concatenate([np.arange(0.0, 30.0, 0.7), np.arange(30.0, 60.0, 0.5)]))
    strokes.add(2, np.arange(0.0, 3.0, 0.8))
    assert strokes.rates(0.0, 29.0) == pytest.approx({1: 1.0 / 0.7})
    assert strokes.rates(31.0, 60.0) == pytest.approx({1: 2.0})


@pytest.mark.fault_case(44)
@given(at=st.floats(-1e9, 1e18), place=st.integers(0, 84))
def test_a_wrong_time_costs_only_itself(at, place):
    """Beyond the width of the smoothing, 20 strokes on either side, the angles are the same but for whole turns."""
    times = np.arange(0.0, 60.0, 0.7)
    wrong = Strokes()
    for time in (*times[:place], at, *times[place:]):
        wrong.add(1, np.array([time]))
    expected, angle = counted(times).angles(TIME)[0], wrong.angles(TIME)[0]
    apart = np.abs(TIME - at) > 20.0 * 0.7
    assert np.abs(np.exp(1j * angle) - np.exp(1j * expected))[apart] == pytest.approx(0.0, abs=1e-4)
