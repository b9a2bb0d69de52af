# SPDX-License-Identifier: Apache-2.0
"""Times of evenly measured samples, from stamps of a host that reads late, rounds, or reads in batches."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.stream_clock import StreamClock

START = 1_700_000_000 * 10**9


def rising(stamps):
    """Return the stamps of a host that needs 20 us for each sample of a batch."""
    each = 20_000 * np.arange(len(stamps))
    return np.maximum.accumulate(stamps - each) + each


def measured(hz, n=3000, drift=0.0):
    return START + np.round(np.arange(n) * 1e9 / hz * (1.0 + drift)).astype(np.int64)


def uneven(kind, true, rng):
    if kind == "host":
        return rising(true + np.round(np.abs(rng.normal(0.0, 1e6, len(true)))).astype(np.int64))
    if kind == "late":
        late = np.where(rng.random(len(true)) < 0.02, rng.exponential(8e6, len(true)), 3e5 * rng.random(len(true)))
        return rising(true + np.round(late).astype(np.int64))
    if kind == "rounded":
        return true // 4_000_000 * 4_000_000
    return rising(-(-true // 16_000_000) * 16_000_000)


@pytest.mark.parametrize("hz", [80.0, 100.0, 104.0])
@pytest.mark.parametrize("drift", [0.0, 1e-4])
@pytest.mark.parametrize("kind", ["host", "late", "rounded", "batches"])
def test_the_steps_of_uneven_stamps_become_those_of_the_sensor(hz, drift, kind):
    true = measured(hz, drift=drift)
    stamps = uneven(kind, true, np.random.default_rng(5))
    kept = np.diff(stamps, prepend=stamps[0] - 1) > 0
    true, stamps = true[kept], stamps[kept]
    late = slice(len(true) // 2, None)
    found = np.diff(StreamClock().times(stamps)[late] - true[late])
    given = np.diff(stamps[late] - true[late])
    assert np.std(found) < max(0.15 * np.std(given), 5e4)


@pytest.mark.parametrize("missing", [0.0, 0.05, 0.5])
def test_even_stamps_are_left_as_they_are_to_the_last_bit(missing):
    stamps = measured(100.0)[np.random.default_rng(1).random(3000) >= missing]
    assert StreamClock().times(stamps).tobytes() == stamps.tobytes()


@pytest.mark.parametrize("lost_ns", [300_000_000, 5_000_000_000])
def test_a_data_gap_stays_a_gap(lost_ns):
    true = measured(100.0)
    true[1500:] += lost_ns
    stamps = uneven("host", true, np.random.default_rng(3))
    times = StreamClock().times(stamps)
    assert times[1500] - times[1499] == pytest.approx(lost_ns, abs=15_000_000)
    assert np.abs(times - stamps).max() < 20_000_000


@given(st.lists(st.integers(1, 399), max_size=6).map(sorted))
def test_any_cut_of_the_stream_gives_the_same(cuts):
    stamps = uneven("late", measured(100.0, 400), np.random.default_rng(3))
    stamps[[100, 200]] = stamps[[99, 150]]
    cut = StreamClock()
    parts = [cut.times(stamps[a:b]) for a, b in itertools.pairwise([0, *cuts, 400])]
    assert np.concatenate(parts).tobytes() == StreamClock().times(stamps).tobytes()


@pytest.mark.parametrize("first", [slice(None, None, 2), slice(None)])
def test_the_times_follow_a_sensor_whose_rate_changes(first):
    true = measured(100.0, 6000)
    second = slice(None) if first.step else slice(None, None, 2)
    true = np.concatenate([true[:3000][first], true[3000:][second]])
    stamps = uneven("host", true, np.random.default_rng(5))
    error = StreamClock().times(stamps) - true
    assert np.abs(error[200:]).max() < 25_000_000
    late = slice(-600, None)
    assert np.std(error[late]) < 0.15 * np.std((stamps - true)[late])


def test_a_stamp_that_goes_back_gives_no_later_time():
    stamps = uneven("host", measured(100.0, 400), np.random.default_rng(3))
    stamps[200], stamps[300:310] = stamps[198], stamps[290:300]
    steps = np.diff(StreamClock().times(stamps))
    assert steps[199] <= 0
    assert steps[299] <= 0


@pytest.mark.parametrize(
    ("hz", "tick_s"), [(100, 0.016), (400, 0.01), (100, 0.02), (50, 1.0), (10, 1.0), (100, 0.08), (104, 0.01)]
)
@pytest.mark.parametrize("early", [False, True])
@pytest.mark.parametrize("drift", [0.0, 0.005])
def test_samples_that_share_a_stamp_get_the_times_of_the_sensor(hz, tick_s, early, drift):
    true = measured(hz, max(3000, round(60 * hz * tick_s)), drift) + 1_234_567
    tick = round(tick_s * 1e9)
    stamps = true // tick * tick if early else -(-true // tick) * tick
    times = StreamClock().times(stamps)
    late = slice(len(true) // 2, None)
    assert np.diff(times).min() > 0
    assert np.std((times - true)[late]) < 0.08 * np.std((stamps - true)[late])
    # The mean over the samples is that of the stamps, within the period that a coarse clock cannot show.
    assert abs(np.mean((times - stamps)[late])) < 1.0e9 / hz


@pytest.mark.parametrize("missing", [0.01, 0.3])
@pytest.mark.parametrize("kind", ["host", "rounded"])
def test_missing_samples_do_not_lead_uneven_stamps_astray(kind, missing):
    rng = np.random.default_rng(5)
    true = measured(100.0, 6000)[rng.random(6000) >= missing]
    stamps = uneven(kind, true, rng)
    late = slice(len(true) // 3, None)
    error = (StreamClock().times(stamps) - true)[late]
    assert np.std(error) < 0.15 * np.std((stamps - true)[late])


@pytest.mark.parametrize("missing", [0.01, 0.05])
@pytest.mark.parametrize(("hz", "tick_s"), [(100, 0.016), (100, 0.02), (100, 0.08), (104, 0.01), (400, 0.016)])
@pytest.mark.parametrize("seed", [0, 1])
def test_missing_samples_shift_only_the_samples_near_them_where_samples_share_a_stamp(hz, tick_s, missing, seed):
    rng = np.random.default_rng(seed)
    true = (measured(hz, 60 * hz) + 1_234_567)[rng.random(60 * hz) >= missing]
    tick = round(tick_s * 1e9)
    late = slice(len(true) // 3, None)
    error = (StreamClock().times(true // tick * tick) - true)[late] * 1e-9 * hz
    assert np.median(np.abs(error - np.median(error))) < 0.4
    # It is not known which of the samples of a stamp is missing, so two steps may be wrong.
    assert np.mean(np.abs(np.diff(error)) > 0.5) < 2.0 * missing + 0.005
