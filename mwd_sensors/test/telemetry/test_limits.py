"""Closed-form limits against an independent computation of them and against drawn noise."""

import numpy as np
import pytest

from mwd_sensors.telemetry import limits
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
