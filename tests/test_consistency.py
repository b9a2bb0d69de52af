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


def errors(rng, runs, n, *, memory=0.0, stays=0.0):
    """Draw errors of variance 1 of first order, shape (runs, n): one share stays a run, the rest has a memory."""
    keep = np.exp(-1.0 / memory) if memory else 0.0
    before = int(5.0 * memory)
    white = np.sqrt(1.0 - keep * keep) * rng.standard_normal((runs, n + before))
    moving = lfilter([1.0], [1.0, -keep], white, axis=1)[:, before:]
    return np.sqrt(stays) * rng.standard_normal((runs, 1)) + np.sqrt(1.0 - stays) * moving


@pytest.mark.parametrize("runs", [1, 3, 12])
@pytest.mark.parametrize(("memory", "n"), [(0.0, 2000), (100.0, 20_000)])
def test_white_and_correlated_runs_count_as_their_independent_samples(runs, memory, n):
    rng = np.random.default_rng(13)
    counts = [independent_samples(list(errors(rng, runs, n, memory=memory))) for _ in range(20)]
    # Squares of a first-order process decorrelate in half its memory: n / (1 + 2 sum exp(-2 k / memory)).
    assert np.median(counts) == pytest.approx(runs * n / (memory or 1.0), rel=0.15)


@pytest.mark.parametrize("runs", [1, 12])
def test_an_error_that_stays_all_run_is_one_sample(runs):
    got = consistency([(np.full(3000, 1.2), 1.0)] * runs)
    assert got.freedom == pytest.approx(runs)
    assert got.inside


@pytest.mark.parametrize("memory", [5.0, 100.0])
@pytest.mark.parametrize("stays", [0.0, 0.1, 0.3, 0.6, 1.0])
def test_runs_whose_sigma_is_right_lie_in_their_band(stays, memory):
    rng = np.random.default_rng(11)
    sets = [errors(rng, 12, 1000, memory=memory, stays=stays) for _ in range(300)]
    inside = sum(consistency([(one, 1.0) for one in error]).inside for error in sets)
    # 285 are expected of a band whose width is known. It comes from the same errors, which costs some: parts that stay
    # and happen to be small look as if they did not stay.
    assert inside >= 265


@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize(("memory", "stays"), [(0.0, 0.0), (5.0, 0.0), (0.0, 1.0)])
def test_few_runs_whose_sigma_is_right_lie_in_their_band(runs, memory, stays):
    rng = np.random.default_rng(14)
    sets = [errors(rng, runs, 200, memory=memory, stays=stays) for _ in range(300)]
    assert sum(consistency([(one, 1.0) for one in error]).inside for error in sets) == pytest.approx(285, abs=12)


@pytest.mark.parametrize(
    ("runs", "memory", "stays", "least"), [(1, 0.0, 0.0, 240), (3, 5.0, 0.0, 170), (12, 0.0, 0.3, 280)]
)
def test_a_sigma_a_quarter_too_small_is_named_by_runs_in_time(runs, memory, stays, least):
    rng = np.random.default_rng(15)
    sets = [errors(rng, runs, 200, memory=memory, stays=stays) for _ in range(300)]
    named = sum(not consistency([(one, 0.8) for one in error], confidence=0.999).inside for error in sets)
    assert named >= least


@pytest.mark.parametrize("stays", [0.0, 0.3])
@pytest.mark.parametrize("wrong", [0.7, 1.4])
def test_runs_whose_sigma_is_wrong_lie_outside(stays, wrong):
    rng = np.random.default_rng(12)
    sets = [wrong * errors(rng, 12, 1000, memory=20.0, stays=stays) for _ in range(100)]
    assert sum(consistency([(one, 1.0) for one in error]).inside for error in sets) <= 20


def test_no_samples_or_a_sigma_of_zero_are_refused():
    with pytest.raises(ValueError, match="positive sigma"):
        assert_consistent([1.0], [0.0])
    with pytest.raises(ValueError, match="samples"):
        assert_consistent([], [])
