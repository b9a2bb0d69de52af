# SPDX-License-Identifier: Apache-2.0
"""Copies of a second publisher are left out, however the stream is cut; readings that repeat by chance are not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_estimation.core.repeated_samples import COPIES, WATCHED, RepeatedSamples
from mwd_sensors.core import wire

MS = 1_000_000


def stream(count, seed, step=0.0):
    """Samples of an IMU at 100 Hz; step: resolution of its readings, 0 for a fine one."""
    random = np.random.default_rng(seed)
    samples = wire.IMU.empty(count)
    samples["stamp_ns"] = 1_772_000_000_000_000_000 + 10 * MS * np.arange(count)
    for name in ("angular_velocity", "linear_acceleration"):
        readings = random.normal(0.0, 1.0, (count, 3))
        samples[name] = np.round(readings / step) * step if step else readings
    return samples


def sent_twice(samples, late_ns, own_stamps):
    """The messages of two publishers in the order in which they come, and which of them are copies."""
    copies = samples.copy()
    if own_stamps:
        copies["stamp_ns"] += late_ns
    at = np.concatenate([samples["stamp_ns"], samples["stamp_ns"] + late_ns])
    order = np.argsort(at, kind="stable")
    return np.concatenate([samples, copies])[order], (np.arange(2 * len(samples)) >= len(samples))[order]


def taken(rule, samples, cut=1 << 30):
    """Places of the samples that come out."""
    places = np.arange(len(samples))
    out = [rule.take(places[k : k + cut], samples[k : k + cut])[0] for k in range(0, len(samples), cut)]
    rest = rule.finish()
    return np.concatenate(out + ([rest[0]] if rest is not None else []))


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    late_ms=st.integers(0, 2000),
    own_stamps=st.booleans(),
    hold=st.booleans(),
    cut=st.sampled_from([1, 2, 7, 100, 5000]),
)
def test_copies_are_left_out_and_no_reading_is_whatever_the_cut(seed, late_ms, own_stamps, hold, cut):
    both, copies = sent_twice(stream(600, seed), late_ms * MS + 1, own_stamps)
    rule = RepeatedSamples(hold=hold)
    fresh = taken(rule, both, cut)
    # Without holding samples back, a copy with a stamp of its own is one only when others before it were.
    passed = COPIES if own_stamps and not hold else 0
    assert np.array_equal(fresh[np.isin(fresh, np.flatnonzero(~copies))], np.flatnonzero(~copies))
    assert len(fresh) - 600 <= passed
    assert rule.count == len(both) - len(fresh)
    assert np.array_equal(taken(RepeatedSamples(hold=hold), both, len(both)), fresh)


@pytest.mark.parametrize("hold", [False, True])
@pytest.mark.parametrize("step", [0.0, 0.01, 0.3, 1.0, 2.0, 10.0])
def test_a_coarse_sensor_that_repeats_itself_loses_no_reading(step, hold):
    assert np.array_equal(taken(RepeatedSamples(hold=hold), stream(60_000, 3, step), 1000), np.arange(60_000))


@pytest.mark.parametrize("hold", [False, True])
def test_a_second_publisher_that_comes_and_leaves_costs_no_reading(hold):
    first, both, last = stream(200, 0), sent_twice(stream(400, 1), 3 * MS, own_stamps=True)[0], stream(3000, 2)
    rule = RepeatedSamples(hold=hold)
    assert len(taken(rule, first)) == len(first)
    assert 400 <= len(taken(rule, both)) <= (400 if hold else 400 + COPIES)
    assert len(taken(rule, last, 100)) == len(last)


def test_a_sensor_that_sticks_while_two_publish_keeps_its_samples():
    samples = stream(1000, 1)
    samples["angular_velocity"][500:] = samples["linear_acceleration"][500:] = 1.5
    both, _ = sent_twice(samples, 3 * MS, own_stamps=True)
    assert np.count_nonzero(taken(RepeatedSamples(), both) >= 1000) > 990


def test_no_more_samples_are_held_back_than_it_takes_to_know():
    samples = stream(400, 1, step=2.0)
    rule, waiting = RepeatedSamples(hold=True), []
    for k in range(400):
        rule.take(np.array([k]), samples[k : k + 1])
        waiting.append(k - rule.first_log_ns if rule.first_log_ns is not None else 0)
    assert max(waiting) <= WATCHED
    assert waiting[-1] == 0


def test_equal_stamps_mean_nothing_where_the_messages_carry_no_time():
    samples = stream(5000, 1, step=10.0)
    samples["stamp_ns"] = 0
    assert len(RepeatedSamples().take(samples["stamp_ns"], samples, stamped=False)[1]) == 5000


@pytest.mark.parametrize("hold", [True, False])
@pytest.mark.parametrize("back_to", [0, 300, 690])
def test_a_recording_that_loops_or_is_sought_backward_is_no_second_publisher(back_to, hold):
    samples, rule = stream(900, 3), RepeatedSamples(hold=hold)
    played = np.concatenate([samples, samples[back_to:], samples[back_to:]])
    assert len(taken(rule, played, cut=50)) == len(played)
    assert rule.count == 0
