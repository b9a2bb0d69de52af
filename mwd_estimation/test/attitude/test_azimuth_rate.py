"""What turns the hole axis: the precision unit's sums, and samples found again by their time."""

from __future__ import annotations

import numpy as np
import pytest

from mwd_estimation.attitude import azimuth_rate as ax

BIN_NS = 500_000_000
LIMIT, VERTICAL = 1.0, 1e-3


def ring(times_ns: list[int], down: tuple[float, float, float], carried: list[float]):
    clock = np.zeros(ax.CLOCK, dtype=np.int64)
    ring_ns, values = np.zeros(ax.RING, dtype=np.int64), np.zeros((ax.RING, ax.RING_ROW))
    n = len(times_ns)
    ring_ns[:n] = times_ns
    values[:n, :3], values[:n, ax.R_CARRIED], values[:n, ax.R_SPIN] = down, carried, 2.0
    clock[ax.HEAD], clock[ax.LENGTH], clock[ax.LAST_NS] = n, n, times_ns[-1]
    return clock, ring_ns, values


def coarse(seconds: float) -> np.ndarray:
    sums = np.zeros(ax.SUMS)
    sums[ax.S_TIME] = seconds
    return sums


def fine_of(stamps: np.ndarray, rates: np.ndarray, seconds: float = 0.5):
    times = [int(t) for t in np.arange(1, 51) * 10_000_000]
    clock, ring_ns, values = ring(times, (0.6, 0.8, 0.0), [0.0] * 50)
    fine = np.zeros(ax.SUMS)
    usable, after = ax.precision_sums(
        LIMIT, VERTICAL, coarse(seconds), fine, BIN_NS, ring_ns, values, clock, stamps, rates, 0
    )
    return usable, after, fine


def test_a_steady_rate_across_a_hole_at_rest_is_the_turn_it_makes() -> None:
    stamps = np.arange(1, 51, dtype=np.int64) * 10_000_000
    rates = np.tile([0.3, 0.02, 0.5], (50, 1))
    usable, after, fine = fine_of(stamps, rates)
    assert usable
    # The last one's stamp is the end of the bin: it belongs to the next.
    assert after == 49
    # d = (.6, .8, 0): turn = w_y / .8; what the missing sample covers is taken in proportion.
    assert fine[ax.S_TURN] == pytest.approx(0.5 * 0.02 / 0.8)
    assert fine[ax.S_Y] == pytest.approx(0.5 / 0.8)
    assert fine[ax.S_Z] == 0.0
    assert fine[ax.S_XY] == pytest.approx(2.0 * 0.5 / 0.8)
    assert fine[ax.S_SPIN] == pytest.approx(2.0 * 0.5)
    assert fine[ax.S_RATE_Z] == pytest.approx(0.5 * 0.5)
    assert fine[ax.S_LAG] == pytest.approx(-2.0 * 0.5 * 0.5 / 0.8)


@pytest.mark.parametrize("spoil", ["clipped", "silent"])
def test_a_bin_with_a_clipped_or_missing_stretch_is_left_to_the_other_unit(spoil: str) -> None:
    stamps = np.arange(1, 51, dtype=np.int64) * 10_000_000
    rates = np.tile([0.3, 0.02, 0.5], (50, 1))
    if spoil == "clipped":
        rates[10, 2] = 1.0
    else:
        stamps, rates = stamps[:35], rates[:35]
    assert not fine_of(stamps, rates)[0]


def test_the_turn_at_a_time_lies_between_its_neighbours_and_the_ends_hold() -> None:
    clock, ring_ns, values = ring([10, 20, 30], (0.0, 1.0, 0.0), [1.0, 2.0, 4.0])
    head, length = clock[ax.HEAD], clock[ax.LENGTH]
    found = [ax.carried_at(ring_ns, values, head, length, at) for at in (5, 10, 15, 25, 30, 40)]
    assert found == [1.0, 1.0, 1.5, 3.0, 4.0, 4.0]
    assert [ax.place_in_ring(ring_ns, head, length, at) for at in (5, 10, 11, 30, 31)] == [3, 3, 2, 1, 0]
