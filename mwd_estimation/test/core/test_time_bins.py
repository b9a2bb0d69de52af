# SPDX-License-Identifier: Apache-2.0
"""Bins are the same however the stream is cut, and their averages are numpy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.time_bins import Binner, average

SECOND = 10**9


def _stream(n, seed=0):
    rng = np.random.default_rng(seed)
    stamps = 1_700_000_000 * SECOND + np.cumsum(rng.integers(1_000_000, 30_000_000, n))
    return stamps, 9.8 + 1e-3 * rng.normal(size=(n, 3))


def _same(a, b):
    return (
        a.index == b.index
        and a.count == b.count
        and all(np.array_equal(getattr(a, k), getattr(b, k)) for k in ("mean", "scatter", "low", "high"))
    )


@given(cuts=st.lists(st.integers(0, 400), max_size=6))
def test_any_cut_into_blocks_gives_the_same_bins(cuts):
    stamps, values = _stream(400)
    whole = Binner(3, SECOND // 2).add(stamps, values)
    binner, pieces = Binner(3, SECOND // 2), []
    for block in np.split(np.arange(400), sorted(cuts)):
        pieces += binner.add(stamps[block], values[block])
    assert len(pieces) == len(whole) > 5
    assert all(_same(a, b) for a, b in zip(pieces, whole, strict=True))


def test_a_bin_is_closed_by_the_first_sample_of_a_later_one_however_many_there_are():
    stamps, values = _stream(20000, 1)
    placed = Binner(3, SECOND // 2).add_placed(stamps, values)
    assert len(placed) > 500
    begins = np.flatnonzero(np.diff(stamps // (SECOND // 2))) + 1
    np.testing.assert_array_equal([place for _, place in placed], begins)
    for closed, inside in zip((one for one, _ in placed), np.split(values, begins), strict=False):
        assert closed.count == len(inside)
        np.testing.assert_allclose(closed.mean, inside.mean(axis=0), rtol=1e-14)
        np.testing.assert_allclose(closed.scatter, (closed.count - 1) * np.cov(inside.T), rtol=1e-9, atol=1e-15)


def test_average_of_bins_is_the_average_of_their_samples():
    stamps, values = _stream(1000, 3)
    bins = Binner(3, SECOND).add(stamps, values)
    inside = (stamps // SECOND >= bins[0].index) & (stamps // SECOND <= bins[-1].index)
    found = average(bins)
    assert found.count == inside.sum()
    np.testing.assert_allclose(found.mean, values[inside].mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(found.covariance, np.cov(values[inside].T) / inside.sum(), rtol=1e-9)
    np.testing.assert_array_equal(np.max([b.high for b in bins], axis=0), values[inside].max(axis=0))


def test_samples_that_are_not_finite_or_come_late_are_left_out():
    stamps, values = _stream(100, 4)
    values[7] = np.nan
    late = np.append(stamps, stamps[:3]), np.vstack([values, values[:3]])
    binner = Binner(3, 10**6 * SECOND)
    assert binner.add(*late) == []
    (closed,) = binner.flush(2 * 10**9 * SECOND)
    assert closed.count == 102
    assert np.isfinite(closed.mean).all()


def test_a_silent_stream_closes_its_bin_only_when_the_bin_is_over():
    stamps, values = _stream(3, 5)
    binner = Binner(3, SECOND)
    binner.add(stamps[:1], values[:1])
    end = (int(stamps[0]) // SECOND + 1) * SECOND
    assert binner.flush(end - 1) == []
    assert len(binner.flush(end)) == 1
    assert binner.flush(end + 5 * SECOND) == []


def test_an_average_of_nothing_is_refused():
    with pytest.raises(ValueError, match="two samples"):
        average([])
