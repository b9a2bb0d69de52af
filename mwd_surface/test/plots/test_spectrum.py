# SPDX-License-Identifier: Apache-2.0
"""Spectra: the density of known signals, whatever the blocks; gaps are left out; the waterfall follows a sweep."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import welch

from mwd_surface.plots.plot_data import Spectrum

RATE = 100.0
S = 1_000_000_000


def taken(signal, length=None, stamps=None, **options):
    count = len(signal)
    stamps = np.round(np.arange(count) / RATE * S).astype(np.int64) if stamps is None else stamps
    spectrum = Spectrum(RATE, signal.shape[1], int(stamps[0]), int(stamps[-1]), **options)
    for k in range(0, count, length or count):
        spectrum.add(stamps[k : k + (length or count)], signal[k : k + (length or count)])
    return spectrum


def test_it_is_welch_s_spectrum_as_scipy_has_it():
    signal = np.random.default_rng(1).standard_normal((5000, 3)) + 4.0
    spectrum = taken(signal, segment=512)
    frequency, expected = welch(signal, RATE, window="hann", nperseg=512, detrend="constant", axis=0)
    assert_allclose(spectrum.frequency, frequency)
    assert_allclose(spectrum.density, expected, rtol=1e-9, atol=1e-15)


def test_white_noise_has_its_density_and_a_sine_its_power():
    noise = 0.3 * np.random.default_rng(2).standard_normal((40_000, 1))
    assert np.mean(taken(noise, segment=256).density[5:-5]) == pytest.approx(0.3**2 / (RATE / 2.0), rel=0.03)
    sine = 2.0 * np.sin(2.0 * np.pi * 12.5 * np.arange(20_000) / RATE)[:, None]
    spectrum = taken(sine, segment=400)
    assert spectrum.frequency[np.argmax(spectrum.density[:, 0])] == 12.5
    assert np.sum(spectrum.density) * RATE / 400 == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize("length", [1, 99, 1024])
def test_blocks_of_any_length_give_the_same_spectrum(length):
    signal = np.random.default_rng(3).standard_normal((3000, 2))
    whole, parts = taken(signal, segment=256), taken(signal, length, segment=256)
    assert_array_equal(whole.density, parts.density)
    assert whole.segments == parts.segments == 22


def test_segments_with_a_gap_or_a_value_that_is_none_are_left_out():
    signal = np.ones((2000, 1))
    signal[500] = np.nan
    stamps = np.round(np.arange(2000) / RATE * S).astype(np.int64)
    stamps[1500:] += 3 * S
    spectrum = taken(signal, stamps=stamps, segment=100)
    assert spectrum.segments == 39 - 2 - 1
    assert np.isfinite(spectrum.density).all()


def test_the_waterfall_follows_a_sweep():
    t = np.arange(20_000) / RATE
    signal = np.sin(2.0 * np.pi * (5.0 * t + 0.5 * 0.15 * t**2))[:, None]
    spectrum = taken(signal, segment=256, bins=20)
    highest = spectrum.frequency[np.nanargmax(spectrum.waterfall[:, :, 0], axis=1)]
    assert_allclose(highest, 5.0 + 0.15 * (np.arange(20) + 0.5) * 10.0, atol=1.0)


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="needs a rate"):
        Spectrum(0.0, 1, 0, S)
    with pytest.raises(ValueError, match="16 samples"):
        Spectrum(RATE, 1, 0, S, segment=8)
