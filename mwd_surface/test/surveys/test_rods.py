# SPDX-License-Identifier: Apache-2.0
"""Depth by counting rods: the tally, its corrections, and its log."""

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.surveys.rods import COLUMNS, RodTally, disagreement, read_log

STEPS = st.lists(
    st.tuples(
        st.sampled_from(["add", "remove", "correct"]),
        st.floats(0.5, 6.0).map(lambda v: round(v, 3)),
        st.integers(0, 80),
        st.text(min_size=1, max_size=8).filter(str.strip),
    ),
    max_size=30,
)


def worked(steps, first=2.0):
    """Return the tally after some steps; a rod is never removed from an empty hole."""
    tally = RodTally(first)
    for k, (action, length, count, words) in enumerate(steps):
        if action == "add":
            tally = tally.add(k, length, words)
        elif action == "correct":
            tally = tally.correct(k, count, length, words, words)
        elif tally.lengths:
            tally = tally.remove(k, words)
    return tally


def logged(tally):
    return ",".join(COLUMNS) + "\n" + "".join(change.line() for change in tally.changes)


@given(STEPS)
def test_the_log_of_a_tally_gives_the_same_tally_again(steps):
    tally = worked(steps)
    again, bad = read_log(io.StringIO(logged(tally), newline=""), tally.first)
    assert bad == 0
    assert again == tally
    assert tally.bit_depth == pytest.approx(2.0 + sum(tally.lengths))


@given(STEPS, st.integers(0, 60))
def test_a_log_that_a_crash_has_cut_gives_the_tally_before_the_cut(steps, cut):
    tally = worked([(*step[:3], "Li") for step in steps])
    text = logged(tally)
    kept = text[: max(len(text) - cut, 0)]
    whole = kept.count("\n") - 1
    again, bad = read_log(io.StringIO(kept, newline=""), tally.first)
    assert bad <= 1
    assert again.changes[: max(whole, 0)] == tally.changes[: max(whole, 0)]


@given(STEPS)
def test_a_rod_added_and_removed_changes_no_depth(steps):
    tally = worked(steps)
    assert tally.add(99, 1.5, "Li").remove(100, "Li").lengths == tally.lengths


def test_a_correction_needs_a_reason_and_stands_in_the_log():
    tally = RodTally(1.0).add(1, 1.5, "Li").add(2, 1.5, "Li")
    with pytest.raises(ValueError, match="reason"):
        tally.correct(3, 3, 1.5, "Li", " ")
    tally = tally.correct(3, 3, 1.5, "Li", "one was not told")
    assert tally.bit_depth == pytest.approx(5.5)
    assert (tally.changes[-1].action, tally.changes[-1].reason) == ("correct", "one was not told")


@pytest.mark.parametrize("count", [-1, 10**9])
def test_an_impossible_count_is_refused(count):
    with pytest.raises(ValueError, match="count"):
        RodTally(1.0).correct(3, count, 1.5, "Li", "typo")


def test_a_tally_that_differs_from_the_rig_by_half_a_rod_is_told():
    tally = RodTally(0.0).correct(1, 41, 1.5, "Li", "counted")
    assert disagreement(tally, 61.5, 1.5) == ""
    assert "41 rods make 61.50 m, the rig says 63.00 m: too few" in disagreement(tally, 63.0, 1.5)
    assert disagreement(tally, float("nan"), 1.5) == ""
