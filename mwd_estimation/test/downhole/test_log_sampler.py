# SPDX-License-Identifier: Apache-2.0
"""Samples of the log channels: rates and sigmas against a simulated detector, sectors, cuts of the streams."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.downhole.log_sampler import LogSampler, rate
from mwd_sensors.core import wire
from mwd_sensors.simulator.gamma import Gamma, GammaDetector
from mwd_sensors.simulator.motion import well_path
from mwd_sensors.telemetry.log_channels import CHANNELS, NO_TOOLFACE, ONE_SIDED, SATURATED, LogChannel

RATE = 100
T0 = 10**18


def streams(seconds=40, turn=2.0, api=((0.0, 90.0),), md=1000.0, inclination=1.4, seed=1, **detector):
    """Attitude and counts of a tool that stands at a depth and turns, turns/s."""
    index = np.arange(1, seconds * RATE + 1)
    stamps = T0 + index * (wire.NANOSECONDS // RATE)
    attitude = wire.ATTITUDE.empty(len(index))
    attitude["stamp_ns"] = stamps
    attitude["gravity_toolface"] = (math.tau * turn * index / RATE) % math.tau
    attitude["sigma_gravity_toolface"] = 0.01
    attitude["inclination"], attitude["sigma_inclination"] = inclination, 0.001
    path = well_path([0.0, 500.0], [0.0, inclination], [0.0, 0.0])
    settings = Gamma(formation=api, sensor_to_bit_m=10.0, **detector)
    model = GammaDetector(settings, path, np.random.default_rng(seed))
    bit = np.full(len(index), md + settings.sensor_to_bit_m)
    counts, _ = model.samples(index, stamps, attitude["gravity_toolface"], bit, RATE)
    return attitude, counts, model


def sampled(attitude, counts, channel=None, cuts=()):
    """All samples of one channel; the streams cut at fractions of their length."""
    sampler = LogSampler({"gamma": channel or LogChannel(sectors=8)})
    first, last = attitude["stamp_ns"][[0, -1]]
    edges, found = [0, *(first + (last - first) * np.array(sorted(cuts))), last], []
    for since, until in itertools.pairwise(edges):
        pieces = (rows[(rows["stamp_ns"] > since) & (rows["stamp_ns"] <= until)] for rows in (counts, attitude))
        sampler.push("counts", next(pieces))
        found += sampler.advance(next(pieces))
    return found + sampler.finish(), sampler


@pytest.mark.parametrize(("api", "dead_time_us"), [(3.0, 20.0), (90.0, 20.0), (600.0, 400.0), (600.0, 1200.0)])
def test_the_rate_is_right_within_its_sigma_at_few_counts_and_with_a_long_dead_time(api, dead_time_us):
    errors = []
    for seed in range(40):
        attitude, counts, _ = streams(22, api=((0.0, api),), dead_time_us=dead_time_us, seed=seed)
        whole = [s for s in sampled(attitude, counts)[0] if s.duration > 9.0]
        errors += [(s.value - api) / s.sigma for s in whole]
    errors = np.array(errors)
    assert len(errors) >= 40
    # Mean and spread of n normalised errors scatter by 1 / sqrt(n) and 1 / sqrt(2 n).
    assert abs(errors.mean()) < 4.0 / math.sqrt(len(errors))
    assert abs(errors.std() - 1.0) < 4.0 / math.sqrt(2.0 * len(errors))
    assert np.mean(np.abs(errors) < 2.0) > 0.85


def test_the_sigma_covers_the_truth_even_where_counts_are_few():
    rng = np.random.default_rng(5)
    for true in (0.5, 2.0, 8.0, 40.0, 400.0):
        value, sigma, _ = rate(rng.poisson(true, 20_000), np.ones(20_000), 0.0)
        # With two expected counts one interval in seven has none: 0 with sigma 0.7. A symmetric sigma covers no more.
        assert np.mean(np.abs(value - true) <= 2.0 * sigma) > (0.92 if true > 5.0 else 0.85), true
        # The variance is half a count larger than the scatter, so that it is not zero if nothing was counted.
        assert np.mean(sigma**2) == pytest.approx(np.var(value) + 0.5, rel=0.03)


def test_a_saturated_detector_says_so():
    attitude, counts, _ = streams(25, api=((0.0, 1500.0),), dead_time_us=2000.0)
    assert all(sample.quality & SATURATED for sample in sampled(attitude, counts)[0])


@pytest.mark.slow
@given(st.lists(st.floats(0.01, 0.99), max_size=6))
def test_samples_do_not_depend_on_how_the_streams_are_cut(cuts):
    attitude, counts, _ = STANDING
    whole, one = sampled(attitude, counts)
    cut, other = sampled(attitude, counts, cuts=cuts)
    assert cut == whole
    assert other.running == one.running


STANDING = streams(33, turn=1.7)


def test_counts_of_the_sectors_and_of_the_intervals_are_the_counts_of_the_detector():
    attitude, counts, _ = STANDING
    found, _ = sampled(attitude, counts)
    # The sampler leaves out the first second, which is incomplete.
    middle = counts["stamp_ns"] - np.round(counts["duration"] * 5e8).astype(int)
    used = counts[middle >= (attitude["stamp_ns"][0] // 10**9 + 1) * 10**9]
    assert sum(sample.counts for sample in found) == used["counts"].sum()
    for sample in found:
        alive = 1.0 - sample.counts / sample.duration * 20e-6
        seen = np.array(sample.sectors) / 1.5 * np.array(sample.sector_durations)
        assert seen.sum() * alive == pytest.approx(sample.counts, rel=1e-3)


@pytest.mark.parametrize("below", [True, False])
def test_the_sectors_see_the_bed_that_comes_near_at_high_angle(below):
    """A bed 0.15 m below or above the hole: the sectors agree with the model and show on which side the bed is."""
    tvd = 500.0 * 2.0 / math.pi
    layers = ((0.0, 40.0), (tvd + 0.15, 140.0)) if below else ((0.0, 140.0), (tvd - 0.15, 40.0))
    attitude, counts, model = streams(240, api=layers, inclination=math.pi / 2.0)
    found, _ = sampled(attitude, counts)
    around = math.tau / 8.0 * np.arange(8)
    expected = model.expected(np.full(8, 1000.0), around)
    whole = [sample for sample in found if sample.duration > 9.0]
    mean, sigma = (
        np.mean([getattr(sample, name) for sample in whole], axis=0) for name in ("sectors", "sigma_sectors")
    )
    # Sectors are averages over their width, the expectation is that of their middle.
    assert np.all(np.abs(mean - expected) < 4.0 * sigma / math.sqrt(len(whole)) + 4.0)
    up, down = mean[0], mean[4]
    assert (down - up if below else up - down) > 20.0


def test_a_tool_that_slides_sees_one_side_only_and_says_so():
    attitude, counts, _ = streams(25, turn=0.0)
    for sample in sampled(attitude, counts)[0]:
        assert sample.quality & ONE_SIDED
        assert np.isfinite(sample.sectors).sum() == 1
        assert math.isfinite(sample.value)


def test_without_a_toolface_the_total_stays_and_the_sectors_are_unknown():
    attitude, counts, _ = streams(25)
    attitude["sigma_gravity_toolface"] = np.nan
    for sample in sampled(attitude, counts)[0]:
        assert sample.quality & NO_TOOLFACE
        assert np.isnan(sample.sectors).all()
        assert sample.value == pytest.approx(90.0, abs=5.0 * sample.sigma)


def test_other_channels_are_means_with_their_sigma():
    attitude, counts, _ = streams(25)
    heat = wire.TEMPERATURE.empty(25)
    heat["stamp_ns"] = T0 + np.arange(1, 26) * 10**9
    heat["temperature"], heat["variance"] = 80.0, 0.25
    sampler = LogSampler(CHANNELS)
    sampler.push("temperature", heat)
    sampler.push("counts", counts)
    found = {sample.channel: sample for sample in sampler.advance(attitude)}
    assert found["temperature"].value == 80.0
    assert found["temperature"].sigma == 0.5
    assert found["inclination"].value == pytest.approx(1.4)
    assert "lateral_vibration" not in found


def test_time_that_goes_back_begins_anew_and_loses_nothing():
    attitude, counts, _ = STANDING
    once, _ = sampled(attitude, counts)
    sampler = LogSampler({"gamma": LogChannel(sectors=8)})
    twice = []
    for _ in range(2):
        for k in range(33):
            sampler.push("counts", counts[25 * k : 25 * k + 25])
            twice += sampler.advance(attitude[100 * k : 100 * k + 100])
    twice += sampler.finish()
    assert [dataclasses.astuple(s) for s in twice[len(once) :]] == [dataclasses.astuple(s) for s in once]
