# SPDX-License-Identifier: Apache-2.0
"""Single wrong rates: doubted at once, while all that a string does to a gyro is believed."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_estimation.core.rate_jumps import RateJumps
from mwd_sensors.simulator import scenario
from mwd_sensors.simulator.sonde import Sonde
from project import SCENARIOS

START = 1_700_000_000 * 10**9


def stamps_of(n, hz=100.0):
    return START + np.round(np.arange(n) * 1e9 / hz).astype(np.int64)


def turning(n=400, hz=100.0, seed=1):
    """Rates of a string at 115 r/min that vibrates."""
    return np.array([12.0, 0.0, 0.0]) + 0.02 * np.random.default_rng(seed).normal(size=(n, 3))


def doubted(rates, hz=100.0):
    return np.isnan(RateJumps().without(stamps_of(len(rates), hz), rates)).any(axis=1)


@given(
    axis=st.integers(0, 2),
    place=st.integers(20, 390),
    length=st.integers(1, 4),
    jump=st.floats(1.5, 60.0),
    sign=st.sampled_from([-1.0, 1.0]),
)
def test_wrong_rates_are_doubted_and_no_others(axis, place, length, jump, sign):
    rates = turning()
    # About the axis a rate that goes on for two samples is a true one.
    length = 1 if axis == 0 else length
    rates[place : place + length, axis] += sign * jump
    assert np.flatnonzero(doubted(rates)).tolist() == list(range(place, min(place + length, 400)))


@given(st.integers(20, 380), st.floats(4.0, 30.0), st.sampled_from([20.0, 100.0, 1000.0]))
def test_a_rate_that_changes_for_good_is_believed_again(place, jump, hz):
    rates = turning()
    rates[place:, 0] += jump
    assert np.flatnonzero(doubted(rates, hz)).tolist() == [place]
    rates = turning()
    rates[place:, 1] += jump
    assert len(np.flatnonzero(doubted(rates, hz))) <= 1 + round(0.05 * hz)


def test_a_stick_slip_release_is_believed():
    speed = np.concatenate([np.zeros(200), np.linspace(0.0, 30.0, 100), np.full(100, 30.0)])
    assert not doubted(turning() + speed[:, None] * [1.0, 0.0, 0.0]).any()


@given(st.lists(st.integers(1, 399), max_size=6).map(sorted))
def test_any_cut_of_the_stream_gives_the_same(cuts):
    rates, stamps = turning(), stamps_of(400)
    rates[[50, 51, 130, 220]] += 8.0
    rates[300:, 2] += 3.0
    rates[40, 1] = np.nan
    cut = RateJumps()
    parts = [cut.without(stamps[a:b], rates[a:b]) for a, b in itertools.pairwise([0, *cuts, 400])]
    assert np.concatenate(parts).tobytes() == RateJumps().without(stamps, rates).tobytes()


def test_after_a_silence_the_first_rates_are_believed():
    rates, stamps = turning(), stamps_of(400)
    rates[200:, 1] += 10.0
    stamps[200:] += 10**9
    assert not np.isnan(RateJumps().without(stamps, rates)).any()


@pytest.mark.slow(10)
@pytest.mark.parametrize("name", ["stick_slip_hell", "bench/shocks", "bench/drillvib", "bench/gyroclip"])
def test_hardly_a_rate_of_a_string_that_shakes_and_sticks_is_doubted(name):
    blocks = Sonde(scenario.read(SCENARIOS / f"{name}.yaml", {"faults": []})).blocks(10.0)
    imu = np.concatenate([block["imu/data_raw"] for block in itertools.islice(blocks, 12)])
    found = np.isnan(RateJumps().without(imu["stamp_ns"], np.ascontiguousarray(imu["angular_velocity"])))
    assert found.any(axis=1).sum() <= 2
