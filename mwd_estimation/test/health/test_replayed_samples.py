# SPDX-License-Identifier: Apache-2.0
"""Samples that come again with new stamps are found wherever they begin; a sensor that keeps still is none."""

import numpy as np
import pytest

from mwd_estimation.core.sensor_fault import FaultCode
from mwd_estimation.health import fault_debounce as debounce
from mwd_estimation.health import stream_checks
from mwd_estimation.health.fault_debounce import AGAINST, FOR, NOTHING
from mwd_estimation.health.motion_window import Samples

N = 50  # samples of half a second


def observed(values: np.ndarray, kept: np.ndarray) -> list[int]:
    """What is observed in each half second of samples, shape (n, 6)."""
    stamps = np.arange(len(values), dtype=np.int64) * 10_000_000
    samples = Samples(stamps, values[:, :3].copy(), values[:, 3:].copy(), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    found = []
    for first in range(0, len(values), N):
        checks = debounce.blank()
        stream_checks.judge_replay(kept, checks, samples, first, first + N, int(stamps[first]))
        found.append(int(checks[FaultCode.REPLAYED, 0]["seen"]))
    return found


# The step of a coarse sensor, in sigmas of its noise.
@pytest.mark.parametrize("step", [1e-3, 0.5])
@pytest.mark.parametrize("late", [0, 17, 31])
def test_old_samples_are_found_wherever_they_begin_and_new_ones_are_not_taken_for_old(step, late):
    rng, kept = np.random.default_rng(4), stream_checks.blank_hashes()
    fresh = np.round(rng.standard_normal((200 * N, 6)) / step) * step
    assert set(observed(fresh, kept)) <= {AGAINST, NOTHING}
    again = observed(fresh[60 * N + late : 100 * N + late], kept)
    assert again.count(FOR) >= 0.8 * len(again)
    assert AGAINST not in again
    assert FOR not in observed(rng.standard_normal((40 * N, 6)), kept)


def test_a_sensor_that_sends_one_value_is_not_taken_for_old_samples():
    kept = stream_checks.blank_hashes()
    assert set(observed(np.full((20 * N, 6), 0.3), kept)) == {NOTHING}
    assert set(observed(np.full((20 * N, 6), 0.3), kept)) == {NOTHING}


def test_samples_that_come_twice_with_their_own_stamps_are_not_old():
    values, kept = np.random.default_rng(5).standard_normal((N, 6)), stream_checks.blank_hashes()
    stamps = np.tile(np.arange(N, dtype=np.int64) * 10_000_000, 2)
    gyro, accel = (np.tile(part, (2, 1)) for part in (values[:, :3], values[:, 3:]))
    checks = debounce.blank()
    samples = Samples(stamps, gyro, accel, np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    stream_checks.judge_replay(kept, checks, samples, 0, 2 * N, 0)
    assert checks[FaultCode.REPLAYED, 0]["seen"] == AGAINST
