# SPDX-License-Identifier: Apache-2.0
"""Stages side by side: order, bounds, failures where they belong, and nothing left running."""

import threading

import pytest

from mwd_surface.processing.bag_estimate import ahead, behind


def _threads():
    return [thread.name for thread in threading.enumerate() if thread.name.startswith(("ahead", "behind"))]


def test_items_come_in_order_and_only_a_few_ahead():
    made = []

    def items():
        for k in range(50):
            made.append(k)
            yield k

    with ahead(items(), depth=2) as ready:
        for k, item in enumerate(ready):
            assert item == k
            # Two wait, one is in hand, one may be on its way.
            assert len(made) <= k + 4
    assert made == list(range(50))
    assert not _threads()


def test_a_failure_ahead_is_raised_after_the_items_before_it():
    def items():
        yield 1
        yield 2
        raise OSError("the disk is gone")

    seen = []
    with pytest.raises(OSError, match="the disk is gone"), ahead(items()) as ready:
        seen += ready
    assert seen == [1, 2]
    with ahead(items()) as ready:
        assert next(ready) == 1
        assert next(ready) == 2
        with pytest.raises(OSError, match="the disk is gone"):
            next(ready)
    assert not _threads()


def test_leaving_early_closes_the_source():
    closed = threading.Event()

    def endless():
        try:
            while True:
                yield 0
        finally:
            closed.set()

    def leave():
        with ahead(endless(), depth=1) as ready:
            assert next(ready) == 0
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        leave()
    assert closed.is_set()
    assert not _threads()


def test_work_behind_is_done_in_order_and_complete_at_the_end():
    done = []
    with behind(done.append, depth=2) as give:
        for k in range(200):
            give(k)
    assert done == list(range(200))
    assert not _threads()


def test_a_failure_behind_is_raised_at_a_later_call_or_at_the_end():
    def work(item):
        if item == 3:
            raise OSError("the disk is full")

    def many():
        with behind(work) as give:
            for k in range(1000):
                give(k)

    with pytest.raises(OSError, match="the disk is full"):
        many()
    with pytest.raises(OSError, match="the disk is full"), behind(work) as give:
        give(3)
    assert not _threads()


def test_nothing_is_worked_on_after_a_failure_behind():
    done = []

    def work(item):
        done.append(item)
        if item == 1:
            raise OSError("the disk is full")

    def four():
        with behind(work) as give:
            for k in range(4):
                give(k)

    with pytest.raises(OSError, match="the disk is full"):
        four()
    assert done == [0, 1]


def test_what_waits_is_dropped_when_the_block_fails():
    begun, go, done = threading.Event(), threading.Event(), []

    def work(item):
        begun.set()
        go.wait()
        done.append(item)

    def fail():
        with behind(work, depth=5) as give:
            for k in range(4):
                give(k)
            begun.wait()
            # The first item is still in hand when the block ends.
            threading.Timer(0.3, go.set).start()
            raise ValueError("no more")

    with pytest.raises(ValueError, match="no more"):
        fail()
    assert done == [0]
    assert not _threads()
