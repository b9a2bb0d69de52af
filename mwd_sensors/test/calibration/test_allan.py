# SPDX-License-Identifier: Apache-2.0
"""Allan deviation: known processes give their known slopes, simulated instruments the figures of their grade."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mwd_sensors.calibration import allan
from mwd_sensors.simulator import instrument, instrument_grade


def markov_deviation(tau, sigma, correlation):
    """Allan deviation of a first-order Markov bias (IEEE Std 952, C.1.6); sigma: its steady 1 sigma; times in s."""
    x = np.asarray(tau, dtype=float) / correlation
    # The bracket loses its digits to cancellation where x is small: there it is the walk it looks like.
    bracket = 1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * np.maximum(x, 1e-12))
    return sigma * np.sqrt(np.where(x < 1e-3, 2.0 * x / 3.0, 2.0 * bracket / np.maximum(x, 1e-12)))


def test_white_noise_falls_with_the_root_of_time_from_its_density():
    rate, density = 100.0, 0.02
    x = density * math.sqrt(rate) * np.random.default_rng(1).standard_normal((200_000, 2))
    curve = allan.allan(x, rate)
    short = curve.sigma < 0.1
    expected = density / np.sqrt(curve.tau)
    assert_allclose(curve.deviation[short], np.stack([expected, expected], axis=-1)[short], rtol=0.15)
    assert allan.figures(curve, 0).white == pytest.approx(density, rel=0.03)


def test_a_random_walk_rises_with_the_root_of_time():
    rate, walk = 10.0, 1e-3
    x = np.cumsum(walk / math.sqrt(rate) * np.random.default_rng(2).standard_normal(200_000))
    curve = allan.allan(x, rate)
    # IEEE Std 952, C.1.4: K sqrt(tau / 3).
    part = (curve.tau > 1.0) & (curve.sigma < 0.08)
    assert_allclose(curve.deviation[part], walk * np.sqrt(curve.tau[part] / 3.0), rtol=0.2)
    assert allan.figures(curve).walk == pytest.approx(walk, rel=0.15)


def test_a_constant_has_no_deviation_and_a_ramp_grows_with_time():
    assert np.abs(allan.allan(np.full(1000, 9.8), 10.0).deviation).max() < 1e-12
    ramp = allan.allan(0.5 * np.arange(5000) / 10.0, 10.0)
    assert_allclose(ramp.deviation, 0.5 * ramp.tau / math.sqrt(2.0), rtol=1e-9)


def test_the_markov_formula_peaks_where_the_standard_says():
    tau = np.linspace(0.5, 5.0, 4501)
    deviation = markov_deviation(tau, 1.0, 1.0)
    assert deviation.max() == pytest.approx(0.617, abs=1e-3)
    assert tau[np.argmax(deviation)] == pytest.approx(1.89, abs=0.01)
    assert_allclose(markov_deviation([0.9999e-3, 1.0001e-3], 1.0, 1.0)[1], math.sqrt(2e-3 / 3.0), rtol=1e-3)


@pytest.mark.parametrize("name", ["mti3", "tactical_north"])
def test_simulated_static_data_has_the_figures_of_its_grade(name):
    grade = instrument_grade.grade(name)
    rng = np.random.default_rng(5)
    triad = instrument.gyro_triad(grade.gyro, rng)
    state = instrument.initial(triad, rng)
    # Two hours of samples of one second: the chain's own slow bias, its noise brought to that rate.
    seconds = 7200
    slow = np.empty((seconds, 3))
    instrument.advance(triad, state, 1.0, np.zeros(seconds), rng.standard_normal((seconds, 2, 3)), slow)
    x = slow + triad.noise * rng.standard_normal(slow.shape)
    curve = allan.allan(x, 1.0)
    got = allan.figures(curve, 0)
    assert got.white == pytest.approx(math.radians(grade.gyro.noise_deg_sqrt_h) / 60.0, rel=0.05)
    expected = np.sqrt(
        triad.noise**2 / curve.tau
        + markov_deviation(curve.tau, triad.instability, triad.instability_s) ** 2
        + triad.walk**2 * curve.tau / 3.0
    )
    sure = curve.sigma < 0.15
    worst = np.abs(np.mean(np.log(curve.deviation[sure]), axis=1) - np.log(expected[sure])).max()
    assert worst < 0.25
    peak = markov_deviation(1.893 * triad.instability_s, triad.instability, triad.instability_s)
    assert peak == pytest.approx(math.radians(grade.gyro.instability_deg_h) / 3600.0, rel=1e-3)


@pytest.mark.parametrize(
    ("samples", "rate", "match"),
    [(np.zeros(10), 1.0, "too few"), (np.zeros(50), 0.0, "rate"), (np.full(50, np.nan), 1.0, "finite")],
)
def test_records_without_an_answer_are_refused(samples, rate, match):
    with pytest.raises(ValueError, match=match):
        allan.allan(samples, rate)
