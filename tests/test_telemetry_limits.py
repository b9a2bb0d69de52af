# SPDX-License-Identifier: Apache-2.0
"""Closed-form limits against an independent computation of them and against drawn noise."""

import numpy as np
import pytest

import telemetry_limits as limits
from mwd_sensors.telemetry.pulse_position import packets


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("ebn0_db", [5.0, 7.0])
def test_packet_errors_are_those_of_drawn_noise(size, ebn0_db):
    trials = 40000
    metric, sent = limits.packet_metrics(np.random.default_rng(3), limits.white_common(ebn0_db, size), size, trials)
    wrong = float(np.mean(metric.argmax(axis=1) != sent))
    bound = limits.packet_error(ebn0_db, size)
    # A union bound lies above, by the chance that two places beat the right one.
    assert bound * 0.8 - 3.0 * np.sqrt(bound / trials) < wrong < bound + 3.0 * np.sqrt(bound / trials)


def test_parity_used_softly_lowers_the_word_error_to_a_half_or_less():
    """At 7 dB 0.066 hard and 0.021 soft for 13 bits (computed with an independent model)."""
    hard, soft = limits.word_error(7.0, 13), limits.soft_word_error(7.0, 13)
    assert hard == pytest.approx(0.06, abs=0.01)
    assert soft == pytest.approx(0.021, abs=0.005)
    assert sum(packets(13)) == 13


def test_pulses_that_resemble_their_neighbours_are_harder_to_tell_apart():
    apart, alike = (20.0 * np.array([1.0, near, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]) for near in (0.0, 0.7))
    assert limits.channel_word_error(alike, 13) > 5.0 * limits.channel_word_error(apart, 13)


@pytest.mark.parametrize(
    ("ebn0_db", "coherent", "dpsk"), [(4.0, 1.3e-2, 4.1e-2), (7.0, 7.7e-4, 3.3e-3), (10.0, 3.9e-6, 2.3e-5)]
)
def test_bit_errors_without_code_are_those_of_the_books(ebn0_db, coherent, dpsk):
    assert limits.bit_error(ebn0_db, "qpsk") == pytest.approx(coherent, rel=0.05)
    assert limits.bit_error(ebn0_db, "dpsk") == pytest.approx(dpsk, rel=0.05)


def test_the_code_gains_and_dpsk_loses():
    """K = 7, rate 1/2: 1e-5 bit errors at 4.2 dB (Proakis, figure 8.3-2), some 5 dB below a carrier without code."""
    assert limits.coded_block_error(4.2, 1, "bpsk") < 1e-5 < limits.coded_block_error(3.5, 1, "bpsk")
    assert limits.coded_block_error(5.5, 64, "dpsk") > limits.coded_block_error(5.5, 64, "qpsk") * 5.0


def test_one_symbol_of_dpsk_is_the_plain_formula():
    for energy in (0.5, 2.0, 5.0):
        assert limits._dpsk_pair(energy, 1) == pytest.approx(0.5 * np.exp(-energy))
