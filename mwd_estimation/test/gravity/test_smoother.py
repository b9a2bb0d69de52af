# SPDX-License-Identifier: Apache-2.0
"""The smoother transposes the steps of the filter, is more accurate, and gives the same result in any blocks."""

import numpy as np
import pytest
from gravity_runs import PARAMS, drilled, error_deg, followed, rms

from mwd_estimation.gravity import smoother
from mwd_estimation.gravity.bounded import information, mechanisation
from mwd_estimation.gravity.bounded.state import STEADY, UpdateSums, initial
from mwd_sensors.core.records import dtype_of


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
        s = initial(PARAMS).record[0]
        s.P[:STEADY, :STEADY], s.sums = np.outer(error, error), sums
        back = known.copy()
        mechanisation.propagate(s, STEADY)
        information.carry_back(sums, back)
        forward = (known.T @ s.P[:STEADY, :STEADY] @ known).item()
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
    data = drilled(case, 40.0)
    ahead, both = followed(data), smoother.smooth(PARAMS, *data[:3])
    assert rms(error_deg(both, data.down)[1000:]) < rms(error_deg(ahead, data.down)[1000:])
    assert np.median(both.sigma_inclination) < np.median(ahead.sigma_inclination)
    assert np.linalg.norm(both.g_t, axis=1) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.slow
def test_a_long_log_in_overlapping_blocks_is_the_log_in_one(monkeypatch):
    data = drilled("surge", 60.0)
    whole = smoother.smooth(PARAMS, *data[:3])
    monkeypatch.setattr(smoother, "BLOCK", 3000)
    monkeypatch.setattr(smoother, "AHEAD", 1500)
    parts = smoother.smooth(PARAMS, *data[:3])
    assert rms(error_deg(parts, whole.g_t)[1000:]) < 0.5 * rms(error_deg(whole, data.down)[1000:])


@pytest.mark.slow
def test_a_stream_cut_anywhere_is_smoothed_to_the_same_bits_and_comes_out_in_time(monkeypatch):
    monkeypatch.setattr(smoother, "BLOCK", 1000)
    monkeypatch.setattr(smoother, "AHEAD", 400)
    data = drilled("surge", 30.0)
    whole = smoother.smooth(PARAMS, *data[:3])
    stream, parts, waiting = smoother.Smoother(PARAMS), [], []
    for block in np.split(np.arange(len(data.stamps)), [1, 400, 2111, 2112]):
        parts.append(stream.push(*data.part(block)[:3]))
        waiting.append(block[-1] + 1 - sum(len(part.g_t) for part in parts))
    parts.append(stream.finish())
    assert max(waiting) <= 1000
    assert smoother.joined(parts).g_t.tobytes() == whole.g_t.tobytes()


def test_a_log_too_short_to_smooth_is_left_as_the_filter_has_it():
    got = smoother.smooth(PARAMS, [0, 10_000_000], np.zeros((2, 3)), np.tile([0.0, 0.0, 9.8], (2, 1)))
    assert got.g_t[-1] == pytest.approx([0.0, 0.0, -1.0])
    assert smoother.smooth(PARAMS, np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3))).g_t.shape == (0, 3)
