# SPDX-License-Identifier: Apache-2.0
"""Depth by counting rods: the tally, its corrections, and its log."""

import resource
import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.signals.cells import plain
from mwd_surface.surveys.rods import COLUMNS, RodLog, RodTally, disagreement, read_log

STEPS = st.lists(
    st.tuples(
        st.sampled_from(["add", "remove", "correct"]),
        st.floats(0.5, 6.0).map(lambda v: round(v, 3)),
        st.integers(0, 80),
        st.text(min_size=1, max_size=8).filter(plain),
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
    again, bad = read_log(logged(tally).encode(), tally.first)
    assert bad == 0
    assert again == tally
    assert tally.bit_depth == pytest.approx(2.0 + sum(tally.lengths))


@given(STEPS, st.data())
def test_a_log_cut_at_any_byte_keeps_each_whole_line_and_the_next_change(steps, data):
    tally = worked([(*step[:3], f'李 "{step[3]}') for step in steps])
    text = logged(tally).encode()
    cut = text[: data.draw(st.integers(0, len(text)))]
    whole = max(0, cut.count(b"\n") - 1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rods.csv"
        path.write_bytes(cut)
        log = RodLog(path)
        again, bad = log.read(tally.first)
        assert bad <= 1
        assert again.changes[:whole] == tally.changes[:whole]
        assert len(again.changes) <= whole + 1
        told = again.add(10**6, 1.25, "王").add(10**6 + 1, 1.25, "王")
        log.keep(told)
        assert RodLog(path).read(tally.first) == (told, bad)
        # Counting the rods ends the doubt about a line that was lost.
        log.keep(counted := told.correct(10**6 + 2, 7, 1.5, "王", "counted"))
        assert RodLog(path).read(tally.first) == (counted, 0)


@given(st.binary(max_size=200), STEPS)
def test_whatever_stands_in_a_log_the_lines_after_it_are_read(rubbish, steps):
    tally = worked(steps)
    again, _ = read_log(rubbish + b"\n" + logged(tally).encode(), tally.first)
    assert again.changes[len(again.changes) - len(tally.changes) :] == tally.changes


def test_a_line_of_any_length_is_not_read_and_hides_no_other():
    tally = worked([("add", 1.5, 0, "Li")] * 3)
    again, bad = read_log(b'"' + b"x" * 200_000 + b"\n" + logged(tally).encode(), tally.first)
    assert (again, bad) == (tally, 1)


def test_of_a_log_that_is_too_long_the_end_is_read_and_a_count_is_asked_for(tmp_path):
    tally = worked([("add", 1.5, 0, "Li")] * 40)
    path = tmp_path / "rods.csv"
    path.write_text(logged(tally), encoding="utf-8")
    short, bad = RodLog(path, most_bytes=1000).read(tally.first)
    assert 0 < len(short.lengths) < 40
    assert bad == 1


def test_changes_that_the_disk_refused_are_written_with_the_next_one(tmp_path, monkeypatch):
    log = RodLog(tmp_path / "rods.csv")
    log.keep(tally := worked([("add", 1.5, 0, "Li")]))

    def refuse(_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr("os.fsync", refuse)
        tally = tally.add(1, 1.5, "Li")
        with pytest.raises(OSError, match="space"):
            log.keep(tally)
    # A disk that takes only a part of a line.
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (log.path.stat().st_size + 10, hard))
    try:
        with pytest.raises(OSError, match="space"):
            log.keep(tally)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert RodLog(log.path).read(2.0) == (RodTally(2.0, tally.lengths[:1], tally.changes[:1]), 0)
    with monkeypatch.context() as full:
        full.setattr("mwd_surface.surveys.rods.sync_folder", refuse)
        tally = tally.add(2, 1.5, "Li")
        with pytest.raises(OSError, match="space"):
            log.keep(tally)
    log.keep(tally := tally.add(3, 1.5, "Li"))
    assert RodLog(log.path).read(2.0) == (tally, 0)


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


@pytest.mark.parametrize("length", [-1.5, 0.0, 31.0, float("nan"), float("inf")])
def test_a_rod_of_an_impossible_length_is_refused_however_it_is_told(length):
    tally = RodTally(1.0)
    for tell in (lambda: tally.add(3, length, "Li"), lambda: tally.correct(3, 2, length, "Li", "counted")):
        with pytest.raises(ValueError, match="length"):
            tell()
    line = f"3,,correct,{length},2,1.0,Li,counted\n"
    assert read_log(line.encode(), 1.0) == (tally, 1)


@pytest.mark.parametrize("count", [-1, 10**9])
def test_an_impossible_count_is_refused(count):
    with pytest.raises(ValueError, match="count"):
        RodTally(1.0).correct(3, count, 1.5, "Li", "typo")


def test_a_tally_that_differs_from_the_rig_by_half_a_rod_is_told():
    tally = RodTally(0.0).correct(1, 41, 1.5, "Li", "counted")
    assert disagreement(tally, 61.5, 1.5) == ""
    assert "41 rods make 61.50 m, the rig says 63.00 m: too few" in disagreement(tally, 63.0, 1.5)
    assert disagreement(tally, float("nan"), 1.5) == ""
