# SPDX-License-Identifier: Apache-2.0
"""Thinning: one row per interval, the same rows wherever blocks end."""

import numpy as np
import pytest

from mwd_sensors.core import wire
from mwd_surface.processing.run_output import Thinner


def _rows(n=1000, seed=1):
    rows = wire.ATTITUDE.empty(n)
    rows["stamp_ns"] = 1_700_000_000 * 10**9 + np.cumsum(np.random.default_rng(seed).integers(500_000, 1_500_000, n))
    return rows


def test_no_rate_keeps_every_row():
    rows = _rows()
    assert rows[Thinner(0.0)(rows["stamp_ns"])].tobytes() == rows.tobytes()


def test_the_first_row_of_each_interval_stays():
    rows = _rows()
    few = rows[Thinner(50.0)(rows["stamp_ns"])]
    intervals = rows["stamp_ns"] // 20_000_000
    assert len(few) == len(np.unique(intervals))
    assert few["stamp_ns"][0] == rows["stamp_ns"][0]


@pytest.mark.parametrize("cuts", [[1], [17, 18, 500], list(range(1, 1000))])
def test_any_cut_into_blocks_picks_the_same_rows(cuts):
    rows = _rows()
    whole = rows[Thinner(100.0)(rows["stamp_ns"])]
    thinner = Thinner(100.0)
    pieces = [part[thinner(part["stamp_ns"])] for part in np.split(rows, cuts)]
    assert np.concatenate(pieces).tobytes() == whole.tobytes()
