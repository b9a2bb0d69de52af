# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.signal import lfilter

from consistency import assert_consistent, consistency, independent_samples

RNG = np.random.default_rng(5)


def test_white_errors_of_their_own_sigma_are_consistent():
    assert_consistent(2.0 * RNG.standard_normal(500), 2.0)


@pytest.mark.parametrize("wrong", [0.8, 1.25])
def test_a_sigma_that_is_wrong_by_a_quarter_is_named(wrong):
    with pytest.raises(AssertionError, match="inclination"):
        assert_consistent(RNG.standard_normal(2000), wrong, name="inclination")


def test_a_correlated_series_counts_as_few_samples():
    n, memory = 20_000, 100.0
    white, series = RNG.standard_normal(n), np.zeros(n)
    keep = np.exp(-1.0 / memory)
    for k in range(1, n):
        series[k] = keep * series[k - 1] + np.sqrt(1.0 - keep * keep) * white[k]
    # Squares of a first-order process decorrelate in half its memory: n / (1 + 2 sum exp(-2 k / memory)).
    assert 0.6 * n / memory < independent_samples(np.split(series, 10)) < n / memory
    assert_consistent(series, 1.0, correlated=True)


@pytest.mark.parametrize("runs", [1, 12])
def test_an_error_that_stays_all_run_is_one_sample(runs):
    got = consistency([(np.full(3000, 1.2), 1.0)] * runs)
    assert got.freedom == pytest.approx(runs)
    assert got.inside


@pytest.mark.parametrize("memory", [5.0, 100.0])
@pytest.mark.parametrize("stays", [0.0, 0.1, 0.3, 0.6, 1.0])
def test_runs_whose_sigma_is_right_lie_in_their_band(stays, memory):
    n, runs, trials = 1000, 12, 300
    keep = np.exp(-1.0 / memory)
    rng = np.random.default_rng(11)
    inside = 0
    for _ in range(trials):
        white = np.sqrt(1.0 - keep * keep) * rng.standard_normal((runs, n + 500))
        moving = lfilter([1.0], [1.0, -keep], white, axis=1)[:, 500:]
        error = np.sqrt(stays) * rng.standard_normal((runs, 1)) + np.sqrt(1.0 - stays) * moving
        inside += consistency([(one, 1.0) for one in error]).inside
    # 285 are expected of a band whose width is known. It comes from the same errors, which costs some: parts that stay
    # and happen to be small look as if they did not stay.
    assert inside >= 265


@pytest.mark.parametrize("stays", [0.0, 0.3])
@pytest.mark.parametrize("wrong", [0.7, 1.4])
def test_runs_whose_sigma_is_wrong_lie_outside(stays, wrong):
    n, runs, inside = 1000, 12, 0
    keep = np.exp(-1.0 / 20.0)
    rng = np.random.default_rng(12)
    for _ in range(100):
        white = np.sqrt(1.0 - keep * keep) * rng.standard_normal((runs, n))
        moving = lfilter([1.0], [1.0, -keep], white, axis=1)
        error = np.sqrt(stays) * rng.standard_normal((runs, 1)) + np.sqrt(1.0 - stays) * moving
        inside += consistency([(wrong * one, 1.0) for one in error]).inside
    assert inside <= 20


def test_no_samples_or_a_sigma_of_zero_are_refused():
    with pytest.raises(ValueError, match="positive sigma"):
        assert_consistent([1.0], [0.0])
    with pytest.raises(ValueError, match="samples"):
        assert_consistent([], [])
