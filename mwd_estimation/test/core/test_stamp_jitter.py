# SPDX-License-Identifier: Apache-2.0
"""The error of uneven stamps, from the stamps alone: whether samples are missing or not."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.stream_clock import StampJitter

START = 1_700_000_000 * 10**9


def late(rng, n, hz, seconds, *, in_order):
    """Errors of stamps, s: of a clock that is read unevenly, or of messages that wait for each other."""
    if not in_order:
        return rng.normal(0.0, seconds, n)
    true = np.arange(n) / hz
    return np.maximum.accumulate(true + rng.uniform(0.0, seconds, n)) - true


def stamps_of(errors, hz):
    return START + np.round((np.arange(len(errors)) / hz + errors) * 1e9).astype(np.int64)


@pytest.mark.fault_case(49)
@pytest.mark.parametrize("hz", [50.0, 100.0, 1000.0])
@pytest.mark.parametrize("share", [0.0, 0.3])
@pytest.mark.parametrize(
    ("periods", "in_order"), [(0.002, False), (0.02, False), (0.1, False), (2.0, True), (20.0, True)]
)
def test_the_error_is_found_within_a_factor_of_two(hz, share, periods, in_order):
    rng = np.random.default_rng(4)
    errors = late(rng, 4000, hz, periods / hz, in_order=in_order)
    stamps = stamps_of(errors, hz)[rng.random(4000) >= share]
    found = StampJitter().sigma(np.maximum.accumulate(stamps))[500:]
    spread = np.std(errors)
    assert 0.5 * spread < np.median(found) < 2.5 * spread


@pytest.mark.parametrize("hz", [20.0, 100.0, 104.0, 1000.0])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.6])
def test_lost_samples_are_no_error_of_the_stamps(hz, share):
    kept = np.random.default_rng(2).random(3000) >= share
    assert StampJitter().sigma(stamps_of(np.zeros(3000), hz)[kept]).max() < 1e-6


@given(st.lists(st.integers(1, 399), max_size=6).map(sorted))
def test_any_cut_of_the_stream_gives_the_same(cuts):
    stamps = stamps_of(late(np.random.default_rng(3), 400, 100.0, 1e-3, in_order=False), 100.0)
    stamps[[100, 200]] = stamps[[99, 150]]
    cut = StampJitter()
    parts = [cut.sigma(stamps[a:b]) for a, b in itertools.pairwise([0, *cuts, 400])]
    assert np.concatenate(parts).tobytes() == StampJitter().sigma(stamps).tobytes()
