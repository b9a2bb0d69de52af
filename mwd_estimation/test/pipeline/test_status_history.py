# SPDX-License-Identifier: Apache-2.0
"""Status at the end of a survey: the same however the stream is cut."""

import itertools

import numpy as np
import pytest

from mwd_estimation.pipeline.estimate import StatusHistory

BIN = 500_000_000
RATE = 10  # rows in a bin


def history(cuts, count=200):
    """The status of row k is k; the first row of bin n + 2 brings bin n + 1 to its end, as `bin_stage` does."""
    kept = StatusHistory(BIN)
    edges = [0, *cuts, count]
    for start, stop in itertools.pairwise(edges):
        places = [k for k in range(start, stop) if k % RATE == 0 and k >= 2 * RATE]
        kept.add(np.arange(start, stop), [(k - start, (k // RATE - 1) * BIN) for k in places])
    return kept


@pytest.mark.parametrize("cuts", [(), (20,), (19, 20, 21, 150), tuple(range(1, 200))])
def test_the_status_is_that_of_the_last_row_of_the_bin_however_the_stream_is_cut(cuts):
    kept = history(cuts)
    for n in range(2, 19):
        assert kept.at(n * BIN) == n * RATE - 1
        assert kept.at(n * BIN - 400_000) == n * RATE - 1  # a survey's end is rounded
    assert kept.at(int(7.5 * BIN)) == 69


def test_before_the_first_bin_the_last_status_is_taken():
    kept = StatusHistory(BIN)
    assert kept.at(0) == 0
    kept.add(np.array([3, 4]), [])
    assert kept.at(BIN) == 4
