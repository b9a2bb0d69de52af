# SPDX-License-Identifier: Apache-2.0
"""Stamps that go back: accepted when several do, with nothing of the new time lost and nothing of the old mixed in."""

import numpy as np
import pytest

from mwd_estimation.core.time_jumps import Clocks
from mwd_sensors.core import wire

SECOND = 10**9


def samples(*seconds):
    out = wire.TEMPERATURE.empty(len(seconds))
    out["stamp_ns"] = np.round(np.array(seconds) * 1e9).astype(np.int64)
    out["temperature"] = seconds
    return out


def seconds(block):
    return (block["stamp_ns"] / SECOND).tolist()


def test_a_stream_that_advances_passes_as_it_is():
    clocks = Clocks()
    assert seconds(clocks.beside("mag", samples(100, 101))) == [100, 101]
    ((whole, new),) = clocks.lead(samples(100, 100.5, 100.2, 101))
    assert len(whole) == 4
    assert new is None


@pytest.mark.fault_case(42)
def test_a_single_stamp_that_is_garbage_changes_nothing():
    clocks = Clocks()
    clocks.lead(samples(100, 101))
    pieces = clocks.lead(samples(102, 3, 103, 104, 5, 6, 105, 106))
    assert [new for _, new in pieces] == [None]
    assert seconds(clocks.beside("mag", samples(100, 101, 7))) == [100, 101]
    assert seconds(clocks.beside("mag", samples(102, 103))) == [102, 103]
    assert not clocks.release()


def test_time_goes_back_after_three_in_a_row_however_they_are_cut():
    for cuts in ([], [3], [2, 3, 4], [1, 2, 3, 4, 5, 6]):
        clocks = Clocks()
        block = samples(100, 101, 20, 21, 22, 23, 24)
        pieces = [piece for part in np.split(np.arange(7), cuts) for piece in clocks.lead(block[part])]
        new = [begun for _, begun in pieces if begun is not None]
        assert [seconds(begun) for begun in new] == [[20, 21, 22]]
        assert sum(len(part) for part, _ in pieces) == 7
        assert clocks.went_back == [(101 * SECOND, 20 * SECOND)]
        # All that follows is of the new time.
        at = next(i for i, (_, begun) in enumerate(pieces) if begun is not None)
        assert [s for part, _ in pieces[at + 1 :] for s in seconds(part)] == [23, 24]


def test_a_stream_that_goes_back_first_waits_for_the_leader():
    clocks = Clocks()
    clocks.beside("mag", samples(100, 101))
    clocks.lead(samples(100, 101))
    assert seconds(clocks.beside("mag", samples(102, 20, 21))) == [102]
    assert seconds(clocks.beside("mag", samples(22))) == []
    (first, second) = clocks.lead(samples(102, 20, 21, 22))
    assert seconds(first[1]) == [20, 21, 22]
    assert len(second[0]) == 0
    assert seconds(clocks.release()["mag"]) == [20, 21, 22]
    assert seconds(clocks.beside("mag", samples(23, 24))) == [23, 24]


def test_what_a_stream_still_says_of_the_old_time_is_dropped():
    clocks = Clocks()
    clocks.beside("mag", samples(100, 101))
    clocks.lead(samples(100, 101, 20, 21, 22))
    assert not clocks.release()
    assert seconds(clocks.beside("mag", samples(102, 103, 21, 22))) == [21, 22]
    assert clocks.dropped == 2
    assert seconds(clocks.beside("mag", samples(23))) == [23]


def test_a_stream_that_was_silent_meanwhile_is_used_again():
    clocks = Clocks()
    clocks.beside("mag", samples(10, 11))
    clocks.lead(samples(100, 101, 50, 51, 52))
    assert seconds(clocks.beside("mag", samples(52, 53))) == [52, 53]


@pytest.mark.fault_case(51)
def test_a_stream_whose_clock_alone_is_set_back_is_not_used():
    clocks = Clocks()
    clocks.beside("mag", samples(100))
    assert all(len(clocks.beside("mag", samples(k * 0.01))) == 0 for k in range(50))
    assert len(clocks.beside("mag", samples(101))) == 0


def test_a_stream_a_whole_loop_ahead_of_the_leader_waits_for_it():
    clocks = Clocks()
    assert seconds(clocks.beside("mag", samples(*range(100, 110), *range(100, 110)))) == list(range(100, 110))
    clocks.lead(samples(*range(100, 110), *range(100, 110)))
    assert seconds(clocks.release()["mag"]) == list(range(100, 110))
