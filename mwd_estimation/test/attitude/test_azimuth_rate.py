# SPDX-License-Identifier: Apache-2.0
"""What turns the hole axis: the precision unit's sums, and samples found again by their time."""

from __future__ import annotations

import numpy as np
import pytest

from mwd_estimation.attitude import gyro_azimuth
from mwd_estimation.attitude.gyro_azimuth_filter import (
    BIN_SUMS,
    GyroAzimuthParams,
    PrecisionRates,
    at_latitude,
    initial,
)
from mwd_sensors.core.arrays import Samples

PARAMS = at_latitude(GyroAzimuthParams(), 60.0)._replace(precision_range=1.0, vertical_sin2=1e-3)


def ring(times_ns: list[int], down: tuple[float, float, float], turns: list[float]) -> Samples:
    """A state that has taken in samples at these times, with the same vertical and a rate of 2 rad/s about the axis."""
    state = initial()
    s, n = state[0], len(times_ns)
    rows = s.recent.rows[:n]
    rows["stamp_ns"], rows["down"], rows["gyro_turn"], rows["gyro"] = times_ns, down, turns, (2.0, 0.0, 0.0)
    s.recent.head, s.recent.length, s.last_ns = n, n, times_ns[-1]
    return state


def precision_of(stamps: np.ndarray, rates: np.ndarray, seconds: float = 0.5):
    state = ring([int(t) for t in np.arange(1, 51) * 10_000_000], (0.6, 0.8, 0.0), [0.0] * 50)
    sums = np.zeros(1, dtype=BIN_SUMS)
    sums["time"] = seconds
    usable, after = gyro_azimuth.precision_sums(PARAMS, state[0], sums[0], PrecisionRates(stamps, rates), 0)
    return usable, after, state[0].precision_sums


def test_a_steady_rate_across_a_hole_at_rest_is_the_turn_it_makes() -> None:
    stamps = np.arange(1, 51, dtype=np.int64) * 10_000_000
    rates = np.tile([0.3, 0.02, 0.5], (50, 1))
    usable, after, sums = precision_of(stamps, rates)
    assert usable
    # The last one's stamp is the end of the bin: it belongs to the next.
    assert after == 49
    # d = (.6, .8, 0): turn = w_y / .8; what the missing sample covers is taken in proportion.
    assert sums.turn == pytest.approx(0.5 * 0.02 / 0.8)
    assert sums.across[0] == pytest.approx(0.5 / 0.8)
    assert sums.across[1] == 0.0
    assert sums.leakage[0] == pytest.approx(2.0 * 0.5 / 0.8)
    assert sums.spin == pytest.approx(2.0 * 0.5)
    assert sums.rate[1] == pytest.approx(0.5 * 0.5)
    assert sums.lag == pytest.approx(-2.0 * 0.5 * 0.5 / 0.8)


@pytest.mark.parametrize("spoil", ["clipped", "silent"])
def test_a_bin_with_a_clipped_or_missing_stretch_is_left_to_the_other_unit(spoil: str) -> None:
    stamps = np.arange(1, 51, dtype=np.int64) * 10_000_000
    rates = np.tile([0.3, 0.02, 0.5], (50, 1))
    if spoil == "clipped":
        rates[10, 2] = 1.0
    else:
        stamps, rates = stamps[:35], rates[:35]
    assert not precision_of(stamps, rates)[0]


def test_the_turn_at_a_time_lies_between_its_neighbours_and_the_ends_hold() -> None:
    s = ring([10, 20, 30], (0.0, 1.0, 0.0), [1.0, 2.0, 4.0])[0]
    found = [gyro_azimuth.gyro_turn_at(s, at) for at in (5, 10, 15, 25, 30, 40)]
    assert found == [1.0, 1.0, 1.5, 3.0, 4.0, 4.0]
