# SPDX-License-Identifier: Apache-2.0
"""A picture of a long recording keeps peaks, densities and deviations, however it is cut; it leaves gaps out."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import welch

from mwd_sensors.calibration.allan import allan
from mwd_surface.plots.plot_data import Envelope, LongAllan, Spectrum

S = 1_000_000_000


def stamps(count, rate=100.0, start=0):
    return start + np.round(np.arange(count) / rate * S).astype(np.int64)


def test_a_short_signal_is_kept_as_it_is():
    t = stamps(500)
    values = np.sin(np.arange(500.0))[:, None]
    envelope = Envelope(0, int(t[-1]), 1, 1600)
    envelope.add(t, values)
    assert envelope.exact
    seconds, line = envelope.line(0)
    assert_array_equal(line, values[:, 0])
    np.testing.assert_allclose(seconds, np.arange(500) / 100.0, atol=1e-9)


def test_one_sample_s_peak_in_an_hour_is_still_drawn():
    t = stamps(360_000)
    values = np.random.default_rng(1).standard_normal((360_000, 2))
    values[123_457, 1] = 80.0
    values[200_001, 1] = -90.0
    envelope = Envelope(0, int(t[-1]), 2, 800)
    envelope.add(t, values)
    seconds, line = envelope.line(1)
    assert len(line) <= 2 * 800
    assert np.nanmax(line) == 80.0
    assert np.nanmin(line) == -90.0
    assert abs(seconds[np.nanargmax(line)] - 1234.57) < 3600.0 / 800
    assert not envelope.exact
    assert envelope.samples == 360_000


def test_a_gap_breaks_the_line_and_missing_values_leave_it_out():
    t = stamps(400)
    keep = (np.arange(400) < 100) | (np.arange(400) >= 200)
    values = np.ones((400, 1))
    values[300:320] = np.nan
    envelope = Envelope(0, int(t[-1]), 1, 1600)
    envelope.add(t[keep], values[keep])
    seconds, line = envelope.line(0)
    missing = seconds[np.isnan(line)]
    assert np.sum((missing > 0.99) & (missing < 2.01)) == 1
    assert np.sum((missing > 2.99) & (missing < 3.2)) == 20
    assert np.all(line[~np.isnan(line)] == 1.0)


@pytest.mark.fault_case(38)
def test_an_angle_near_north_does_not_jump_and_a_full_turn_breaks_the_line():
    t = stamps(100)
    near_north = (np.sin(np.arange(100.0)) % 360.0)[:, None]
    near = Envelope(0, int(t[-1]), 1, 1600, circle=360.0)
    near.add(t, near_north)
    assert np.ptp(near.line(0)[1]) < 2.1
    turning = Envelope(0, int(t[-1]), 1, 1600, circle=360.0)
    turning.add(t, (np.arange(100.0) * 10.0 % 360.0)[:, None])
    assert np.isnan(turning.line(0)[1]).sum() == 3


def test_samples_outside_the_span_are_left_out():
    envelope = Envelope(0, S, 1, 10)
    envelope.add(np.array([-1, 0, S, S + 1]), np.array([[9.0], [1.0], [2.0], [9.0]]))
    assert envelope.samples == 2
    assert_array_equal(envelope.line(0)[1], [1.0, 2.0])


RATE = 100.0


def taken(signal, at=None, **options):
    at = stamps(len(signal)) if at is None else at
    spectrum = Spectrum(RATE, signal.shape[1], int(at[0]), int(at[-1]), **options)
    spectrum.add(at, signal)
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


def test_segments_with_a_gap_or_a_value_that_is_none_are_left_out():
    signal = np.ones((2000, 1))
    signal[500] = np.nan
    at = stamps(2000)
    at[1500:] += 3 * S
    spectrum = taken(signal, at, segment=100)
    assert spectrum.segments == 39 - 2 - 1
    assert np.isfinite(spectrum.density).all()


def test_the_waterfall_follows_a_sweep():
    t = np.arange(20_000) / RATE
    signal = np.sin(2.0 * np.pi * (5.0 * t + 0.5 * 0.15 * t**2))[:, None]
    spectrum = taken(signal, segment=256, bins=20)
    highest = spectrum.frequency[np.nanargmax(spectrum.waterfall[:, :, 0], axis=1)]
    assert_allclose(highest, 5.0 + 0.15 * (np.arange(20) + 0.5) * 10.0, atol=1.0)


def noise(count, seed=1):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((count, 2)) + np.cumsum(0.01 * rng.standard_normal((count, 2)), axis=0)


def test_a_record_that_fits_is_the_kernel_s_own():
    samples = noise(5000)
    record = LongAllan(100.0, 2)
    for k in range(0, 5000, 333):
        record.add(samples[k : k + 333])
    got, expected = record.curve(), allan(samples, 100.0)
    assert_array_equal(got.tau, expected.tau)
    assert_array_equal(got.deviation, expected.deviation)
    assert record.samples == 5000


@pytest.mark.parametrize("length", [1000, 100_001])
def test_a_record_that_does_not_fit_agrees_within_its_sigma(length):
    samples = noise(200_000)
    record = LongAllan(100.0, 2, capacity=8192)
    for k in range(0, len(samples), length):
        record.add(samples[k : k + length])
    got, expected = record.curve(), allan(samples, 100.0)
    assert np.all(np.diff(got.tau) > 0.0)
    assert got.tau[0] == 0.01
    assert got.tau[-1] > 0.9 * expected.tau[-1]
    for axis in range(2):
        same = np.exp(np.interp(np.log(got.tau), np.log(expected.tau), np.log(expected.deviation[:, axis])))
        assert np.all(np.abs(got.deviation[:, axis] / same - 1.0) < 4.0 * got.sigma + 0.02)


def test_a_short_record_is_refused():
    with pytest.raises(ValueError, match="too few"):
        LongAllan(100.0, 1).curve()


def line(values, blocks):
    at = stamps(len(values))
    envelope = Envelope(0, int(at[-1]), 2, 90)
    for block in blocks:
        envelope.add(at[block], values[block])
    return (*envelope.line(0), *envelope.line(1))


def density(values, blocks):
    at = stamps(len(values))
    spectrum = Spectrum(RATE, 2, 0, int(at[-1]), segment=256)
    for block in blocks:
        spectrum.add(at[block], values[block])
    return spectrum.density, spectrum.segments


def deviation(values, blocks):
    record = LongAllan(RATE, 2, capacity=1024)
    for block in blocks:
        record.add(values[block])
    return (record.curve().deviation,)


@pytest.mark.parametrize("length", [1, 77, 1024])
@pytest.mark.parametrize("summary", [line, density, deviation])
def test_blocks_of_any_length_give_the_same(summary, length):
    values, whole = noise(3000), np.arange(3000)
    blocks = [whole[k : k + length] for k in range(0, 3000, length)]
    for one, other in zip(summary(values, [whole]), summary(values, blocks), strict=True):
        assert_array_equal(one, other)


def test_the_order_of_arrival_changes_no_line():
    values, whole = noise(1000), np.arange(1000)
    shuffled = np.random.default_rng(4).permutation(1000)
    for one, other in zip(line(values, [whole]), line(values, [shuffled]), strict=True):
        assert_array_equal(one, other)
