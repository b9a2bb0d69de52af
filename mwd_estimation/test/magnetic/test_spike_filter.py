# SPDX-License-Identifier: Apache-2.0
"""Spikes of a magnetometer go, a lasting disturbance and a turning tool with a bias do not."""

import numpy as np
import pytest

from mwd_estimation.magnetic import spike_filter


def field(n=400, turns_per_s=0.0, bias=0.0, seed=1):
    """A tool that turns, at 20 Hz: stamps, ns, and field, T, shape (n, 3)."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / 20.0
    angle = 2.0 * np.pi * turns_per_s * t
    b_t = np.column_stack([np.full(n, 4e-5), 3e-5 * np.cos(angle) + bias, 3e-5 * np.sin(angle)])
    return (t * 1e9).astype(np.int64), b_t + rng.normal(scale=1e-7, size=(n, 3))


@pytest.mark.parametrize("turns_per_s", [0.0, 1.3])
def test_spikes_are_marked_and_nothing_else(turns_per_s):
    stamps, b_t = field(turns_per_s=turns_per_s)
    spikes = np.arange(20, 400, 50)
    b_t[spikes] *= 3.0
    b_t[spikes + 7, 1] -= 2e-5
    sound = spike_filter.run(spike_filter.initial(), stamps, b_t)
    assert not sound[spikes].any()
    assert sound.sum() >= 400 - 2 * len(spikes)


def test_a_turning_tool_with_a_bias_is_no_spike():
    stamps, b_t = field(turns_per_s=2.58, bias=2e-6)
    assert spike_filter.run(spike_filter.initial(), stamps, b_t).all()


def test_external_interference_that_stays_counts_after_a_few_samples():
    stamps, b_t = field()
    b_t[200:] *= 1.4
    sound = spike_filter.run(spike_filter.initial(), stamps, b_t)
    assert np.flatnonzero(~sound).tolist() == [200, 201, 202, 203, 204]


def test_after_a_silence_and_before_it_knows_enough_nothing_is_called_a_spike():
    stamps, b_t = field(n=40)
    b_t[4] *= 3.0
    stamps[20:] += 60_000_000_000
    b_t[20:] *= 1.5
    assert spike_filter.run(spike_filter.initial(), stamps, b_t).all()


@pytest.mark.parametrize(
    ("jump", "gap_s", "sound"), [(2.8e-6, 0.0, True), (3.2e-6, 0.0, False), (3.2e-6, 9.0, False), (3.2e-6, 11.0, True)]
)
def test_in_a_steady_field_a_jump_of_three_microtesla_is_a_spike_unless_ten_seconds_are_missing(jump, gap_s, sound):
    stamps, b_t = np.arange(20) * 50_000_000, np.tile([5e-5, 0.0, 0.0], (20, 1))
    b_t[-1, 0] += jump
    stamps[-1] += round(gap_s * 1e9)
    assert spike_filter.run(spike_filter.initial(), stamps, b_t)[-1] == sound


@pytest.mark.parametrize(("spreads", "sound"), [(7.5, True), (8.5, False)])
def test_where_the_strength_varies_a_spike_is_eight_times_the_usual_distance_away(spreads, sound):
    distance = 1e-6
    strength = 5e-5 + distance * (-1.0) ** np.arange(20)
    # The median of nine values that alternate is one of them; half of the distances from it are zero.
    strength[10:19] = 5e-5 + distance * np.array([-1.0, 1.0, -1.0, 1.0, 0.0, -1.0, 1.0, -1.0, 1.0])
    strength[-1] = 5e-5 + spreads * distance
    b_t = np.column_stack([strength, np.zeros(20), np.zeros(20)])
    assert spike_filter.run(spike_filter.initial(), np.arange(20) * 50_000_000, b_t)[-1] == sound


def test_one_by_one_or_in_blocks_gives_the_same_and_what_is_not_finite_is_left_to_others():
    stamps, b_t = field(turns_per_s=0.7)
    b_t[::37] *= 2.0
    b_t[50, 2] = np.nan
    whole = spike_filter.run(spike_filter.initial(), stamps, b_t)
    state = spike_filter.initial()
    single = [spike_filter.run(state, stamps[k : k + 1], b_t[k : k + 1])[0] for k in range(200)]
    kept = state.copy()
    rest = spike_filter.run(state, stamps[200:], b_t[200:])
    assert np.concatenate([single, rest]).tolist() == whole.tolist()
    assert spike_filter.run(kept, stamps[200:], b_t[200:]).tolist() == rest.tolist()
    assert whole[50]
