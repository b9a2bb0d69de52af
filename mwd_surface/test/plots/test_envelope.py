# SPDX-License-Identifier: Apache-2.0
"""Envelopes: no peak is lost, memory does not grow, blocks and order do not matter, gaps and circles break the line."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from mwd_surface.plots.plot_data import Envelope

S = 1_000_000_000


def stamps(count, rate=100.0, start=0):
    return start + np.round(np.arange(count) / rate * S).astype(np.int64)


def test_a_short_signal_is_kept_as_it_is():
    t = stamps(500)
    values = np.sin(np.arange(500.0))[:, None]
    envelope = Envelope(0, int(t[-1]), 1, 1600)
    envelope.add(t, values)
    assert envelope.exact
    seconds, line = envelope.line(0)
    assert_array_equal(line, values[:, 0])
    np.testing.assert_allclose(seconds, np.arange(500) / 100.0, atol=1e-9)


def test_one_sample_s_peak_in_an_hour_is_still_drawn():
    t = stamps(360_000)
    values = np.random.default_rng(1).standard_normal((360_000, 2))
    values[123_457, 1] = 80.0
    values[200_001, 1] = -90.0
    envelope = Envelope(0, int(t[-1]), 2, 800)
    envelope.add(t, values)
    seconds, line = envelope.line(1)
    assert len(line) <= 2 * 800
    assert np.nanmax(line) == 80.0
    assert np.nanmin(line) == -90.0
    assert abs(seconds[np.nanargmax(line)] - 1234.57) < 3600.0 / 800
    assert not envelope.exact
    assert envelope.samples == 360_000


@pytest.mark.parametrize("length", [1, 7, 1000])
def test_blocks_of_any_length_give_the_same_line(length):
    t, values = stamps(1000), np.random.default_rng(2).standard_normal((1000, 1))
    whole, parts = Envelope(0, int(t[-1]), 1, 90), Envelope(0, int(t[-1]), 1, 90)
    whole.add(t, values)
    for k in range(0, 1000, length):
        parts.add(t[k : k + length], values[k : k + length])
    for a, b in zip(whole.line(0), parts.line(0), strict=True):
        assert_array_equal(a, b)


def test_the_order_of_arrival_does_not_matter():
    t, values = stamps(1000), np.random.default_rng(3).standard_normal((1000, 1))
    shuffled = np.random.default_rng(4).permutation(1000)
    straight, mixed = Envelope(0, int(t[-1]), 1, 90), Envelope(0, int(t[-1]), 1, 90)
    straight.add(t, values)
    mixed.add(t[shuffled], values[shuffled])
    for a, b in zip(straight.line(0), mixed.line(0), strict=True):
        assert_array_equal(a, b)


def test_a_gap_breaks_the_line_and_missing_values_leave_it_out():
    t = stamps(400)
    keep = (np.arange(400) < 100) | (np.arange(400) >= 200)
    values = np.ones((400, 1))
    values[300:320] = np.nan
    envelope = Envelope(0, int(t[-1]), 1, 1600)
    envelope.add(t[keep], values[keep])
    seconds, line = envelope.line(0)
    missing = seconds[np.isnan(line)]
    assert np.sum((missing > 0.99) & (missing < 2.01)) == 1
    assert np.sum((missing > 2.99) & (missing < 3.2)) == 20
    assert np.all(line[~np.isnan(line)] == 1.0)


@pytest.mark.fault_case(38)
def test_an_angle_near_north_does_not_jump_and_a_full_turn_breaks_the_line():
    t = stamps(100)
    near_north = (np.sin(np.arange(100.0)) % 360.0)[:, None]
    near = Envelope(0, int(t[-1]), 1, 1600, circle=360.0)
    near.add(t, near_north)
    assert np.ptp(near.line(0)[1]) < 2.1
    turning = Envelope(0, int(t[-1]), 1, 1600, circle=360.0)
    turning.add(t, (np.arange(100.0) * 10.0 % 360.0)[:, None])
    assert np.isnan(turning.line(0)[1]).sum() == 3


def test_samples_outside_the_span_are_left_out_and_an_empty_span_is_refused():
    envelope = Envelope(0, S, 1, 10)
    envelope.add(np.array([-1, 0, S, S + 1]), np.array([[9.0], [1.0], [2.0], [9.0]]))
    assert envelope.samples == 2
    assert_array_equal(envelope.line(0)[1], [1.0, 2.0])
    with pytest.raises(ValueError, match="needs a span"):
        Envelope(S, 0, 1)
