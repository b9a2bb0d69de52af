# SPDX-License-Identifier: Apache-2.0
"""The smoother transposes the steps of the filter, is more accurate, and gives the same result in any blocks."""

import numpy as np
import pytest

from mwd_estimation.core.track import Track
from mwd_estimation.gravity import smoother
from mwd_estimation.gravity.bounded import filter as bounded
from mwd_estimation.gravity.bounded import information, mechanisation
from mwd_estimation.gravity.bounded.state import ERRORS, STEADY, UpdateSums
from mwd_sensors.core.records import dtype_of
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS

BENCH = SCENARIOS / "bench"


def drilled(case: str, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    blocks = []
    for block in Sonde(scenario.read(BENCH / f"{case}.yaml")).blocks(5.0):
        blocks.append(block)
        if len(blocks) * 5.0 >= seconds:
            break
    imu = np.concatenate([block["imu/data_raw"] for block in blocks])
    truth = np.concatenate([block["truth"] for block in blocks])
    down = truth["gravity"][np.searchsorted(truth["stamp_ns"], imu["stamp_ns"])]
    return imu["stamp_ns"], imu["angular_velocity"], imu["linear_acceleration"], down


def rms_deg(track: Track, down: np.ndarray, skip: int) -> float:
    cross = np.linalg.norm(np.cross(track.g_t, down), axis=1)[skip:]
    return float(np.degrees(np.sqrt(np.mean(np.arctan2(cross, np.sum(track.g_t * down, axis=1)[skip:]) ** 2))))


def sums_of(rng: np.random.Generator) -> np.ndarray:
    sums = np.zeros(1, dtype_of(UpdateSums))[0]
    sums.time = 0.04
    sums.bias[:] = rng.standard_normal((2, 3))
    sums.scale[:] = rng.standard_normal(2)
    sums.askew[:] = rng.standard_normal((2, 2))
    sums.force[:] = rng.standard_normal(3)
    return sums


def test_what_is_carried_back_is_the_transpose_of_what_the_filter_carries_forward():
    rng = np.random.default_rng(2)
    sums = sums_of(rng)
    for _ in range(5):
        error, known = rng.standard_normal(STEADY), rng.standard_normal((STEADY, 1))
        P = np.zeros((ERRORS, ERRORS))
        P[:STEADY, :STEADY] = np.outer(error, error)
        back = known.copy()
        mechanisation.propagate(P, sums, STEADY)
        information.carry_back(sums, back)
        forward = (known.T @ P[:STEADY, :STEADY] @ known).item()
        assert forward == pytest.approx((back.T @ error).item() ** 2, rel=1e-12)


def test_a_measurement_adds_its_information_and_hides_what_it_has_corrected():
    rng = np.random.default_rng(3)
    root = rng.standard_normal((STEADY, STEADY))
    A = np.hstack([root @ root.T, rng.standard_normal((STEADY, 1))])
    h, gain, w = rng.standard_normal(STEADY), rng.standard_normal(STEADY), np.zeros(STEADY + 1)
    C = np.eye(STEADY) - np.outer(gain, h)
    expected = C.T @ A[:, :-1] @ C + np.outer(h, h) / 0.3, C.T @ A[:, -1] + h * 0.2 / 0.3
    information.add_measurement(A, h, gain, 0.2, 0.3, w)
    assert A[:, :-1] == pytest.approx(expected[0], rel=1e-12, abs=1e-12)
    assert A[:, -1] == pytest.approx(expected[1], rel=1e-12, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["biasdrift", "surge", "stickslip", "gyroclip"])
def test_the_smoother_is_better_than_the_filter_and_says_so(case):
    stamps, gyro, accel, down = drilled(case, 40.0)
    p = bounded.BoundedParams()
    ahead = bounded.run(p, bounded.initial(p), stamps, gyro, accel)
    both = smoother.smooth(p, stamps, gyro, accel)
    assert rms_deg(both, down, 1000) < rms_deg(ahead, down, 1000)
    assert np.median(both.sigma_inclination) < np.median(ahead.sigma_inclination)
    assert np.linalg.norm(both.g_t, axis=1) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.slow
def test_a_long_log_in_overlapping_blocks_is_the_log_in_one(monkeypatch):
    stamps, gyro, accel, down = drilled("surge", 60.0)
    p = bounded.BoundedParams()
    whole = smoother.smooth(p, stamps, gyro, accel)
    monkeypatch.setattr(smoother, "BLOCK", 3000)
    monkeypatch.setattr(smoother, "AHEAD", 1500)
    parts = smoother.smooth(p, stamps, gyro, accel)
    assert len(parts.g_t) == len(stamps)
    difference = np.degrees(np.linalg.norm(parts.g_t - whole.g_t, axis=1))
    assert np.sqrt(np.mean(difference[1000:] ** 2)) < 0.5 * rms_deg(whole, down, 1000)


@pytest.mark.slow
def test_a_stream_cut_anywhere_is_smoothed_to_the_same_bits_and_comes_out_in_time(monkeypatch):
    monkeypatch.setattr(smoother, "BLOCK", 1000)
    monkeypatch.setattr(smoother, "AHEAD", 400)
    stamps, gyro, accel, _ = drilled("surge", 30.0)
    p = bounded.BoundedParams()
    whole = smoother.smooth(p, stamps, gyro, accel)
    stream, parts, waiting = smoother.Smoother(p), [], []
    for block in np.split(np.arange(len(stamps)), [1, 400, 2111, 2112]):
        parts.append(stream.push(stamps[block], gyro[block], accel[block]))
        waiting.append(block[-1] + 1 - sum(len(part.g_t) for part in parts))
    parts.append(stream.finish())
    assert max(waiting) <= 1000
    assert smoother.joined(parts).g_t.tobytes() == whole.g_t.tobytes()


def test_a_log_too_short_to_smooth_is_left_as_the_filter_has_it():
    p = bounded.BoundedParams()
    got = smoother.smooth(p, [0, 10_000_000], np.zeros((2, 3)), np.tile([0.0, 0.0, 9.8], (2, 1)))
    assert got.g_t[-1] == pytest.approx([0.0, 0.0, -1.0])
    assert smoother.smooth(p, np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3))).g_t.shape == (0, 3)
