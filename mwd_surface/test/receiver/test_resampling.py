# SPDX-License-Identifier: Apache-2.0
"""Samples of any rate on an even grid: the same bits however they are cut, and the signal as it was."""

import numpy as np
import pytest
from traced_memory import peak_bytes

from mwd_surface.receiver.resampling import Resampler, interpolate

STEP = 0.05


def resampled(time, value, cuts=()):
    stream = Resampler(STEP)
    out = [stream.push(t, v) for t, v in zip(np.split(time, cuts), np.split(value, cuts), strict=True)]
    out.append(stream.finish())
    return np.concatenate([values for values, _ in out]), np.concatenate([known for _, known in out])


@pytest.mark.parametrize("rate", [25.0, 100.0, 8000.0])
def test_a_slow_tone_comes_through_unchanged(rate):
    time = 3.0 + np.arange(0.0, 20.0, 1.0 / rate)
    values, known = resampled(time, np.sin(2.0 * np.pi * 0.7 * time))
    at = 3.0 + STEP * np.arange(len(values))
    inner = slice(20, -20)
    assert known[inner].all()
    # 25 Hz is hardly more than the grid: its kernel has few samples.
    assert values[inner] == pytest.approx(np.sin(2.0 * np.pi * 0.7 * at[inner]), abs=0.02)


def test_a_tone_beyond_the_band_is_taken_out():
    time = np.arange(0.0, 20.0, 0.005)
    values, _ = resampled(time, np.sin(2.0 * np.pi * 9.0 * time))
    assert np.abs(values[20:-20]).max() < 0.02


def test_any_cut_gives_the_same_bits():
    random = np.random.default_rng(2)
    time = np.sort(random.uniform(0.0, 30.0, 1500))
    value = random.normal(size=1500)
    whole = resampled(time, value)
    for cuts in ([1], [10, 63, 64, 65, 700], range(7, 1500, 7)):
        parts = resampled(time, value, list(cuts))
        assert np.array_equal(parts[0], whole[0])
        assert np.array_equal(parts[1], whole[1])


def test_a_gap_and_samples_that_are_no_numbers_are_unknown():
    time = np.arange(0.0, 20.0, 0.01)
    value = np.ones(len(time))
    value[100:120] = np.nan
    kept = (time < 8.0) | (time > 11.0)
    values, known = resampled(time[kept], value[kept])
    at = STEP * np.arange(len(values))
    assert not known[(at > 8.5) & (at < 10.5)].any()
    assert known[(at > 1.4) & (at < 7.5)].all()
    assert not known[(at > 1.04) & (at < 1.16)].any()
    assert values[known > 0.0] == pytest.approx(1.0)


def test_values_between_those_of_a_grid_are_those_of_the_tone():
    grid = np.sin(0.5 * np.arange(200.0))
    out = np.empty(80)
    interpolate(grid, 10.3, 1.7, out)
    assert out == pytest.approx(np.sin(0.5 * (10.3 + 1.7 * np.arange(80))), abs=1e-4)


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_spikes_of_single_samples_are_taken_out_and_steps_stay(rate):
    time = np.arange(0.0, 40.0, 1.0 / rate)
    step = np.floor(time / 5.0)
    clean = np.sin(0.7 * time) + step + 0.01 * np.random.default_rng(3).normal(size=len(time))
    spiked = clean.copy()
    spiked[211::97] += 50.0
    # A cubic through four neighbours has little more noise than a sample.
    assert np.abs(resampled(time, spiked)[0] - resampled(time, clean)[0]).max() < 0.05
    # Of a step no sample is changed: the low-pass filter is linear.
    twice = resampled(time, 2.0 * step + time)[0]
    assert twice == pytest.approx(resampled(time, step + time)[0] + resampled(time, step)[0], abs=1e-9)


def test_a_whole_file_in_one_block_takes_no_more_memory_than_a_few_copies_of_it():
    """20 million samples, 40 MB of WAV, took more than 3 GB in lists."""
    time = np.arange(200_000) / 192_000.0
    value = np.random.default_rng(1).normal(size=len(time))
    Resampler(0.01).push(time[:100], value[:100])
    assert peak_bytes(lambda: Resampler(0.01).push(time, value)) < 90.0 * len(time)
