# SPDX-License-Identifier: Apache-2.0
"""Noise made white: the filter undoes an autoregressive process and forgets a disturbance."""

import numpy as np
import pytest
from scipy import signal

from mwd_surface.receiver.whitening import filtered, precision, steadiness, steady_filter

KNOWN = np.ones(4000)


def coloured(seed=1, n=4000):
    return np.cumsum(signal.lfilter([1.0], [1.0, -1.2, 0.8], np.random.default_rng(seed).normal(size=n + 100)))[100:]


def whitened(noise, taps):
    return filtered(noise, taps)[100:]


def test_coloured_noise_becomes_white_and_of_unit_size():
    out = whitened(coloured(), steady_filter(coloured(), KNOWN, 16, 1e-6))
    assert np.std(out) == pytest.approx(1.0, abs=0.05)
    lags = [np.mean(out[k:] * out[:-k]) for k in range(1, 12)]
    assert np.abs(lags).max() < 4.0 / np.sqrt(len(out))


def test_a_stall_does_not_spoil_the_noise_model():
    noise = coloured()
    stalled = noise.copy()
    stalled[1000:1200] += 500.0 * np.random.default_rng(3).normal(size=200)
    plain, robust = (steady_filter(one, KNOWN, 16, 1e-6) for one in (noise, stalled))
    assert np.std(whitened(noise, robust)) == pytest.approx(np.std(whitened(noise, plain)), rel=0.1)


def test_disturbed_samples_weigh_little_and_unknown_ones_nothing():
    noise = np.random.default_rng(4).normal(size=2000)
    noise[500:550] *= 20.0
    known = np.ones(2000)
    known[1500:1600] = 0.0
    weight = steadiness(noise, known)
    assert weight[505:545].max() < 0.05
    assert not weight[1500:1600].any()
    assert np.mean(weight[600:1400]) > 0.99


def test_the_precision_is_that_of_the_noise():
    """Also of a single sample and of noise little larger than usual, which a mean over 25 samples hides or leaves."""
    noise = np.random.default_rng(4).normal(size=2000)
    assert 1.0 - precision(noise, np.ones(2000)).mean() < 1e-3
    noise[500:550] *= 3.0
    noise[1000] = 8.0
    known = np.ones(2000)
    known[1500:1600] = 0.0
    weight = precision(noise, known)
    assert weight[505:545].mean() == pytest.approx(1.0 / 9.0, rel=0.5)
    assert weight[1000] < 0.05
    assert weight[980:995].min() > 0.9
    assert not weight[1500:1600].any()


@pytest.mark.parametrize("size", [1e2, 1e8])
def test_the_precision_is_known_in_any_disturbance(size):
    noise = np.random.default_rng(5).normal(size=1000)
    noise[400:440] *= size
    weight = precision(noise, np.ones(1000))
    assert np.all(np.isfinite(weight))
    assert weight[400:440].max() < 1e-2
    assert np.mean(weight[:390]) > 0.99


def test_a_constant_has_no_noise_model():
    assert steady_filter(np.full(4000, 2.0e7), KNOWN, 16, 1e-6) is None
