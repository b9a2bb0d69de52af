# SPDX-License-Identifier: Apache-2.0
"""Allan deviation of a long record: what fits is exact, what does not fit agrees within its own sigma."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from mwd_sensors.calibration.allan import allan
from mwd_surface.plots.plot_data import LongAllan


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


def test_blocks_of_any_length_keep_the_same_means():
    samples = noise(50_000)
    records = [LongAllan(100.0, 2, capacity=1024) for _ in range(2)]
    records[0].add(samples)
    for k in range(0, len(samples), 77):
        records[1].add(samples[k : k + 77])
    assert_array_equal(records[0].curve().deviation, records[1].curve().deviation)


def test_an_odd_capacity_and_a_short_record_are_refused():
    with pytest.raises(ValueError, match="even"):
        LongAllan(100.0, 1, capacity=65)
    with pytest.raises(ValueError, match="too few"):
        LongAllan(100.0, 1).curve()
