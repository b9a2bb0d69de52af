# SPDX-License-Identifier: Apache-2.0
"""Copies of a second publisher are left out, however the stream is cut; readings that repeat by chance are not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mwd_estimation.core.repeated_samples import COPIES, REMEMBERED, RepeatedSamples
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


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    late_ms=st.integers(0, 2000),
    own_stamps=st.booleans(),
    cut=st.sampled_from([1, 2, 7, 100, 5000]),
)
def test_copies_are_left_out_and_no_reading_is_whatever_the_cut(seed, late_ms, own_stamps, cut):
    both, copies = sent_twice(stream(600, seed), late_ms * MS + 1, own_stamps)
    rule = RepeatedSamples()
    fresh = np.concatenate([rule.fresh(both[k : k + cut]) for k in range(0, len(both), cut)])
    assert fresh[~copies].all()
    # A copy with a stamp of its own is one only when others before it were.
    assert np.count_nonzero(fresh[copies]) <= (COPIES if own_stamps else 0)
    assert rule.count == np.count_nonzero(~fresh)
    whole = RepeatedSamples().fresh(both)
    assert np.array_equal(whole, fresh)


@pytest.mark.parametrize("step", [0.0, 0.01, 0.3, 1.0, 2.0, 10.0])
def test_a_coarse_sensor_that_repeats_itself_loses_no_reading(step):
    assert RepeatedSamples().fresh(stream(60_000, 3, step)).all()


def test_a_second_publisher_that_leaves_leaves_no_trace():
    samples = stream(400, 1)
    both, _ = sent_twice(samples, 3 * MS, own_stamps=True)
    rule = RepeatedSamples()
    assert not rule.fresh(both).all()
    assert rule.fresh(stream(3 * REMEMBERED, 2)).all()


def test_a_sensor_that_sticks_while_two_publish_keeps_its_samples():
    samples = stream(1000, 1)
    samples["angular_velocity"][500:] = samples["linear_acceleration"][500:] = 1.5
    both, _ = sent_twice(samples, 3 * MS, own_stamps=True)
    fresh = RepeatedSamples().fresh(both)
    assert np.count_nonzero(fresh[1000:]) > 990


def test_equal_stamps_mean_nothing_where_the_messages_carry_no_time():
    samples = stream(5000, 1, step=10.0)
    samples["stamp_ns"] = 0
    assert RepeatedSamples().fresh(samples, stamped=False).all()
