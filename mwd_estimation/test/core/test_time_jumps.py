# SPDX-License-Identifier: Apache-2.0
"""Stamps that go back: accepted when several do, with nothing of the new time lost and nothing of the old mixed in."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

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


@pytest.mark.parametrize("begin", [20.0, 110.0])
@pytest.mark.parametrize("sent", range(6))
def test_a_stream_of_which_some_samples_came_before_the_leader_jumped_loses_none_and_is_used_at_once(sent, begin):
    clocks, new = Clocks(), begin + 0.1 * np.arange(10)
    clocks.beside("mag", samples(100, 101))
    clocks.lead(samples(100, 101))
    assert seconds(clocks.beside("mag", samples(*new[:sent]))) == []
    before_ns = clocks.lead_ns
    (_, went_back), *_ = clocks.lead(samples(*new[:3]))
    released = clocks.reached(before_ns) if went_back is None else clocks.release()
    used = [stamp for block in released.values() for stamp in seconds(block)]
    assert len(used) == sent
    used += seconds(clocks.beside("mag", samples(*new[sent:])))
    assert used == pytest.approx(new.tolist())
    assert clocks.dropped == 0


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


@pytest.mark.fault_case(44)
@pytest.mark.parametrize("ahead", [1.5, 5.0, 1e3, 1e9])
def test_a_single_stamp_of_the_future_changes_nothing_either(ahead):
    clocks = Clocks()
    clocks.lead(samples(100, 100.1))
    ((block, new),) = clocks.lead(samples(100.2, 100.2 + ahead, 100.3, 100.4))
    assert new is None
    # What comes behind sees the time go back for a sample, so that it rejects it.
    assert block["stamp_ns"][1] < block["stamp_ns"][0]
    assert seconds(block) == pytest.approx([100.2, 100.2, 100.3, 100.4], abs=1e-6)
    assert seconds(clocks.beside("mag", samples(100, 100.1, 100.1 + ahead, 100.2, 100.3))) == [100, 100.1, 100.2, 100.3]
    assert (clocks.dropped, clocks.went_back, clocks.lead_ns) == (1, [], 100_400_000_000)


@pytest.mark.parametrize("set_at", [100.0, 115.0, 130.0])
@pytest.mark.parametrize("off", [-0.9, 0.0, 0.9])
def test_a_clock_set_back_by_the_length_of_a_gap_of_the_leader_shows_in_the_other_stream(set_at, off):
    clocks, true = Clocks(), np.arange(90.0, 140.0, 0.1)
    stamps = np.where(true > set_at, true - 30.0 + off, true)
    given, hidden = [], []
    for place in range(len(true)):
        given += seconds(clocks.beside("mag", samples(stamps[place])))
        hidden += [place] if clocks.hidden_jump else []
        clocks.hidden_jump = False
        if not 100.0 < true[place] < 130.0:
            clocks.lead(samples(stamps[place]))
            given += [s for waited in clocks.reached(clocks.lead_ns).values() for s in seconds(waited)]
    assert len(hidden) == 1
    assert len(clocks.went_back) == 1
    # Nothing of the new time is lost once the leader is there.
    assert given[-90:] == pytest.approx(stamps[-90:].tolist())


def test_after_a_data_gap_the_leader_goes_on_and_no_sample_beside_it_is_lost():
    for cuts in ([], [1], [2, 3], [1, 2, 3, 4, 5]):
        clocks, given = Clocks(), []
        clocks.beside("mag", samples(100, 101))
        clocks.lead(samples(100, 101))
        for part in np.split(np.arange(6), cuts):
            given += seconds(clocks.beside("mag", samples(900, 901, 902, 903, 904, 905)[part]))
            before_ns = clocks.lead_ns
            ((block, new),) = clocks.lead(samples(900, 901, 902, 903, 904, 905)[part])
            assert new is None
            given += [stamp for waited in clocks.reached(before_ns).values() for stamp in seconds(waited)]
        assert given == [900, 901, 902, 903, 904, 905]
        assert (clocks.dropped, clocks.lead_ns) == (0, 905 * SECOND)
    assert len(block)


@pytest.mark.fault_case(51)
@pytest.mark.parametrize("off", [-12.0, -3.0, 12.0, 3600.0])
def test_a_stream_whose_clock_was_wrong_for_a_while_is_used_as_soon_as_it_is_right_again(off):
    clocks, used = Clocks(), []
    for k in range(600):
        now = 100.0 + 0.1 * k
        sent = now + (off if 200 <= k < 350 else 0.0)
        used += [(k, stamp) for stamp in seconds(clocks.beside("mag", samples(sent)))]
        before_ns = clocks.lead_ns
        clocks.lead(samples(now))
        used += [(k, stamp) for waited in clocks.reached(before_ns).values() for stamp in seconds(waited)]
    right = [stamp for _, stamp in used]
    assert right == [100.0 + 0.1 * k for k in range(600) if not 200 <= k < 350 and k >= 0] or off == 12.0
    # Samples that the leader has come to meanwhile are of its time, as far as it can tell.
    assert np.isin(np.round(100.0 + 0.1 * np.arange(355, 600), 6), np.round(right, 6)).all()
    assert used[-1] == (599, right[-1])


@example(gaps=[(38, 2.0), (5, 2.0)], block=50)
@given(
    gaps=st.lists(st.tuples(st.integers(5, 60), st.floats(1.0, 500.0)), min_size=1, max_size=6),
    block=st.sampled_from([1, 7, 50, 1000]),
)
def test_no_sample_is_lost_at_data_gaps_however_far_a_stream_is_read_ahead_of_the_leader(gaps, block):
    steps = np.concatenate([[0.0, *[0.1] * 9], *([gap, *[0.1] * (count - 1)] for count, gap in gaps)])
    stamps, clocks, taken = 1000.0 + np.cumsum(steps), Clocks(), []
    for part in np.array_split(stamps, range(block, len(stamps), block)):
        taken += seconds(clocks.beside("mag", samples(*part)))
        for one in part:
            before_ns = clocks.lead_ns
            clocks.lead(samples(one))
            for waiting in clocks.reached(before_ns).values():
                taken += seconds(waiting)
    # The stream may end before a jump is confirmed, but here it does not.
    assert taken == pytest.approx(stamps.tolist())
    assert clocks.dropped == 0


@pytest.mark.parametrize("period", [1.0 + 1e-5, 5.0, 60.0])
@pytest.mark.parametrize("cuts", [[], [1], [1, 2, 3, 4, 5], [4]])
def test_each_sample_of_a_slow_stream_is_used_when_it_comes_from_the_first_on(period, cuts):
    clocks, stamps = Clocks(), 100.0 + period * np.arange(6)
    for part in np.split(stamps, cuts):
        assert len(clocks.beside("temperature", samples(*part))) == len(part)
    assert clocks.dropped == 0


def test_a_stream_slower_than_once_a_second_is_used_without_end():
    clocks, given = Clocks(), []
    for k in range(100, 1000):
        if k % 60 == 40:
            given += seconds(clocks.beside("temperature", samples(k)))
        before_ns = clocks.lead_ns
        clocks.lead(samples(k, k + 0.5))
        given += [stamp for waited in clocks.reached(before_ns).values() for stamp in seconds(waited)]
    # The samples that confirm the first step of the stream are released together.
    assert given == [*range(100, 1000, 60)]
    assert clocks.dropped == 0


@pytest.mark.parametrize("gap", [5.0, 9.0, 40.0])
@pytest.mark.parametrize("back", [2.0, 20.0])
@pytest.mark.parametrize("length", [7, 50, 1000])
def test_a_data_gap_after_a_jump_back_is_not_a_return_however_far_the_leader_is_behind(length, back, gap):
    clocks = Clocks()
    old, new = np.arange(100.0, 130.0, 0.1), np.arange(130.0 - back, 200.0, 0.1)
    beside = np.concatenate([old, new[new < 140.0], new[new >= 140.0 + gap]])
    lead = np.concatenate([old, new])
    found = []
    for start in range(0, len(lead) + length, length):
        found += seconds(clocks.beside("mag", samples(*beside[start : start + length])))
        before = clocks.lead_ns
        for _, begun in clocks.lead(samples(*lead[max(start - length, 0) : start])):
            if begun is not None:
                # The estimate begins anew, without the samples that it was given before.
                found = [s for part in clocks.release().values() for s in seconds(part)]
        found += [s for part in clocks.reached(before).values() for s in seconds(part)]
    # A sample within a second of the leader needs no confirmation, so a few may go to the estimate that ends.
    assert found == pytest.approx(beside[len(beside) - len(found) :])
    assert len(beside) - len(old) - len(found) <= 20
