# SPDX-License-Identifier: Apache-2.0
"""Clipped samples are bounds: the pressure that replaces them is beyond the limit, and the same for any cut."""

import dataclasses
import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from link_runs import TOOLS, pairs, simulated

from mwd_surface.receiver.clipping import Declipper
from mwd_surface.receiver.pulse.pulse_receiver import decode
from mwd_surface.receiver.words import BELIEVED

RATE = 50.0
TIME = np.arange(6000) / RATE


def pressure(seed):
    """Pressure of a pump whose rate hunts, with drilling noise, Pa."""
    random = np.random.default_rng(seed)
    turns = np.cumsum(1.45 * (1.0 + 0.002 * np.sin(0.3 * TIME))) / RATE
    pump = sum(size * np.cos(2.0 * np.pi * k * turns + k) for k, size in ((1, 0.5), (3, 1.0), (6, 0.6), (9, 0.3)))
    slow = np.convolve(random.normal(size=len(TIME) + 99), np.hanning(100), "valid")
    return 2.0e7 + 3.0e4 * pump + 2.0e4 * slow / slow.std() + random.normal(0.0, 400.0, len(TIME))


def clipped(value, low, high):
    return np.clip(value, np.quantile(value, low), np.quantile(value, high))


def rms(error, at):
    return float(np.sqrt(np.mean(error[at] ** 2)))


def through(value, cuts=()):
    stage = Declipper(1.0 / RATE)
    parts = [stage.push(t, v) for t, v in zip(np.split(TIME, cuts), np.split(value, cuts), strict=True)]
    return np.concatenate([*parts, stage.finish()], axis=1)


LIMITS = pytest.mark.parametrize(("low", "high"), [(0.0, 0.85), (0.2, 1.0), (0.1, 0.9)])


@LIMITS
def test_a_clipped_sample_lies_beyond_the_limit_and_nearer_to_the_pressure(low, high):
    true = pressure(1)
    seen = clipped(true, low, high)
    time, got = through(seen)
    np.testing.assert_array_equal(time, TIME)
    at = (seen == seen.max()) & (high < 1.0) | (seen == seen.min()) & (low > 0.0)
    np.testing.assert_array_equal(got[~at], seen[~at])
    assert np.all(np.where(seen[at] > np.median(seen), got[at] - seen[at], seen[at] - got[at]) >= 0.0)
    assert rms(got - true, at) < 0.5 * rms(seen - true, at)


@LIMITS
def test_a_slow_gauge_with_lines_above_half_its_rate_is_replaced_nearly_as_well(low, high):
    """At 5 Hz three of the four lines of the pump are folded; the model needs two coefficients for each."""
    seen, true = clipped(pressure(1), low, high)[::10], pressure(1)[::10]
    stage = Declipper(10.0 / RATE)
    got = np.concatenate([stage.push(TIME[::10], seen)[1], stage.finish()[1]])
    at = (seen != true) & (TIME[::10] > 40.0)
    assert rms(got - true, at) < 0.4 * rms(seen - true, at)


@functools.cache
def clipped_and_whole(low):
    """Pressure that is clipped above and, if `low` is not 0, below; the same through the stage in one piece."""
    seen = clipped(pressure(2), low, 0.85)
    return seen, through(seen)


@settings(max_examples=settings().max_examples // 3)
@given(st.lists(st.integers(0, len(TIME)), max_size=20), st.sampled_from([0.0, 0.1]))
def test_any_cut_of_a_clipped_stream_gives_the_same_bits(cuts, low):
    seen, whole = clipped_and_whole(low)
    np.testing.assert_array_equal(through(seen, sorted(cuts)), whole)


def test_samples_that_do_not_clip_are_passed_on_at_once_and_unchanged():
    stage, true = Declipper(1.0 / RATE), pressure(3)
    for begin in range(0, len(TIME), 37):
        time, value = stage.push(TIME[begin : begin + 37], true[begin : begin + 37])
        np.testing.assert_array_equal(time, TIME[begin : begin + 37])
        np.testing.assert_array_equal(value, true[begin : begin + 37])


@pytest.mark.parametrize("places", [[100], [1500], list(range(60, 6000, 500))])
def test_spikes_beyond_the_limit_do_not_hide_it(places):
    true = pressure(5)
    seen = clipped(true, 0.0, 0.85)
    seen[places] += 3.0e5
    got = through(seen)[1]
    near = np.isin(np.arange(len(TIME)), np.add.outer(places, np.arange(-40, 41)))
    at = (seen != true) & ~near & (TIME > 40.0)
    assert rms(got - true, at) < 0.3 * rms(seen - true, at)


@pytest.mark.parametrize("every", [1, 5])
def test_no_sample_waits_longer_than_some_seconds_at_any_rate(every):
    seen, stage = clipped(pressure(6), 0.0, 0.85)[::every], Declipper(every / RATE)
    waiting = 0
    for time, value in zip(TIME[::every], seen, strict=True):
        waiting += 1 - len(stage.push(np.array([time]), np.array([value]))[0])
        assert waiting * every / RATE < 10.0


def test_samples_before_a_gap_in_time_do_not_belong_to_the_model_after_it():
    seen = clipped(pressure(7), 0.0, 0.85)
    other = seen.copy()
    other[:3000] = clipped(pressure(8), 0.0, 0.7)[:3000] - 3.0e4
    other[:3000] = np.minimum(other[:3000], seen.max())
    other[:20], seen[:20] = seen.max(), seen.max()
    time = TIME + np.where(TIME[3000] <= TIME, 60.0, 0.0)
    got = []
    for one in (seen, other):
        stage = Declipper(1.0 / RATE)
        got.append(np.concatenate([stage.push(time, one), stage.finish()], axis=1)[1])
    np.testing.assert_array_equal(got[0][3000:], got[1][3000:])


@pytest.mark.parametrize("value", [0.0, 2.0e7])
def test_a_gauge_that_stays_at_a_limit_stays_as_it_is(value):
    held = pressure(4)
    held[2000:4000] = value
    np.testing.assert_array_equal(through(np.minimum(held, 2.0e7 + 1e6))[1], held)


@pytest.mark.parametrize(
    "value",
    [
        np.minimum(np.sin(8.0 * TIME), 0.5),
        np.clip(1e3 * np.sin(8.0 * TIME) + 1e7, 1e7 - 1.0, 1e7 + 1.0),
        np.round(np.minimum(np.sin(8.0 * TIME) + 1e-12 * np.sin(1e3 * TIME), 0.5), 12),
        np.where(np.arange(len(TIME)) % 2, 1.0, 3.0),
        np.minimum(np.arange(len(TIME)) % 100, 50.0),
        np.full(len(TIME), 2.0e7),
    ],
)
def test_a_signal_without_noise_has_finite_values_beyond_its_limits(value):
    got = through(value)[1]
    assert np.isfinite(got).all()
    assert np.all(np.where(value == value.max(), got >= value, np.where(value == value.min(), got <= value, True)))
    assert np.ptp(got) < 20.0 * np.ptp(value) + 1e-9


@pytest.mark.slow(8)
@pytest.mark.parametrize(("low", "high"), [(0.0, 0.85), (0.2, 1.0)])
def test_a_clipping_gauge_costs_few_words(low, high):
    tool, depth = TOOLS["0.5"], 4000.0
    run = simulated("0.5", depth)
    flows = run.time_s > run.sent.words[0].start_s - 10.0
    limits = np.quantile(run.pressure_pa[flows], (low, high))
    limits = np.where([low > 0.0, high < 1.0], limits, [-np.inf, np.inf])
    believed = []
    for seen in (run.pressure_pa, np.clip(run.pressure_pa, *limits)):
        both = pairs(dataclasses.replace(run, pressure_pa=seen), decode(tool, run.time_s, seen).words, tool, depth)
        believed.append(np.mean([word.status == BELIEVED for _, word in both]))
        assert all(sent.raw == word.raw for sent, word in both if word.status == BELIEVED)
    assert believed[1] > 0.8 * believed[0]
