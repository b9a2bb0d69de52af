# SPDX-License-Identifier: Apache-2.0
"""Soft decisions on the convolutional code: against drawn noise, the union bound, and their own probabilities."""

import numpy as np
import pytest

import telemetry_limits as limits
from mwd_sensors.telemetry import convolution
from mwd_surface.receiver.carrier import convolutional


def drawn(ebn0_db, blocks, seed=1):
    """Bits sent and their posteriors in white noise of a given energy per bit."""
    random = np.random.default_rng(seed)
    for _ in range(blocks):
        bits = random.integers(0, 2, 64)
        variance = 1.0 / limits.ratio(ebn0_db)
        got = 1.0 - 2.0 * convolution.encode(bits) + random.normal(size=140) * np.sqrt(variance)
        yield bits, convolutional.decode(2.0 * got / variance)


def test_block_errors_are_those_of_the_union_bound():
    wrong = np.mean([np.any((found < 0.0) != bits) for bits, (found, _, _) in drawn(3.0, 2000)])
    bound = limits.coded_block_error(3.0, 64, "bpsk")
    assert 0.3 * bound < wrong < bound


def test_posteriors_of_bits_are_true():
    """Bits claimed with some probability are right that often."""
    ratios, right = [], []
    for bits, (found, _, _) in drawn(1.0, 3000):
        ratios += np.abs(found).tolist()
        right += ((found < 0.0) == bits).tolist()
    claimed = 1.0 / (1.0 + np.exp(-np.array(ratios)))
    unsure = claimed < 0.95
    assert np.mean(np.array(right)[unsure]) == pytest.approx(claimed[unsure].mean(), abs=0.015)


def test_without_noise_all_coded_bits_come_back():
    bits = np.random.default_rng(2).integers(0, 2, 40)
    coded = convolution.encode(bits)
    found, both, _ = convolutional.decode(8.0 * (1.0 - 2.0 * coded))
    assert np.array_equal(found < 0.0, bits == 1)
    assert np.array_equal(both < 0.0, coded == 1)
