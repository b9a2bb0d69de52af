# SPDX-License-Identifier: Apache-2.0
"""Single wrong stamps cost one sample; where a clock was set, the time runs on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.receiver.lone_stamps import LONGEST_GAP_S, STEP_S, SteadyTimes, lone
from mwd_surface.receiver.table_times import in_order

COUNT = 60
TIMES = 0.5 * np.arange(COUNT)
FAR = st.floats(-1e12, 1e12).filter(lambda at: at < -STEP_S - 1.0 or at > TIMES[-1] + STEP_S + 1.0)


def steady_by(times, cut):
    """The samples that a stream passes on, given in blocks; the value of a sample is its number."""
    stream, found = SteadyTimes(), []
    for part in np.split(np.arange(len(times)), range(cut, len(times), cut)):
        found += zip(*stream.steady(times[part], part.astype(float)), strict=True)
    return np.array(found).reshape(-1, 2)


def with_time(place, at):
    times = TIMES.copy()
    times[place] = at
    return times


@pytest.mark.fault_case(44)
@given(at=FAR, place=st.integers(1, COUNT - 2), cut=st.integers(1, COUNT))
def test_a_lone_wrong_time_of_a_table_or_a_stream_costs_its_own_sample_only(at, place, cut):
    times, others = with_time(place, at), np.delete(np.arange(COUNT), place)
    assert np.flatnonzero(lone(times)).tolist() == [place]
    found, rows, notes = in_order(times)
    assert np.array_equal(rows, others)
    assert np.array_equal(found, TIMES[others])
    assert len(notes) == 1
    assert np.array_equal(steady_by(times, cut), np.column_stack([TIMES[others], others]))


@given(ahead=st.floats(STEP_S + 2.0, 1e12), first=st.booleans())
def test_the_first_or_the_last_time_may_be_the_wrong_one(ahead, first):
    times = with_time(0, TIMES[0] + ahead) if first else with_time(-1, TIMES[-1] - ahead)
    assert np.flatnonzero(lone(times)).tolist() == [0 if first else COUNT - 1]


def test_pauses_set_clocks_and_interleaved_clocks_have_no_lone_times():
    assert not lone(np.concatenate([TIMES, TIMES + 600.0])).any()
    assert not lone(np.concatenate([TIMES, TIMES - 600.0])).any()
    assert not lone(np.stack([TIMES, TIMES + 10.0], axis=1).ravel()).any()


@pytest.mark.fault_case(43)
@given(jump=st.one_of(st.floats(-1e9, -STEP_S - 1.0), st.floats(LONGEST_GAP_S + 1.0, 1e9)), cut=st.integers(1, COUNT))
def test_the_time_runs_on_where_a_clock_is_set(jump, cut):
    times = TIMES.copy()
    times[30:] += jump
    found = steady_by(times, cut)
    assert np.array_equal(found[:, 1], np.arange(COUNT))
    steps = np.diff(found[:, 0])
    assert np.all(steps >= 0.0)
    assert np.all(steps < 0.5 + 1e-6)


@given(pause=st.floats(STEP_S + 1.0, LONGEST_GAP_S - 1.0), cut=st.integers(1, COUNT))
def test_a_pause_stays_a_pause(pause, cut):
    times = TIMES.copy()
    times[30:] += pause
    assert np.array_equal(steady_by(times, cut)[:, 0], times)
