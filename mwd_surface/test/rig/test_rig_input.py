# SPDX-License-Identifier: Apache-2.0
"""Rig data are accepted only where they are possible; a jump of depth must be confirmed."""

import math

import pytest
from example_surveys import S

from mwd_sensors.core import wire
from mwd_surface.rig.input import PLAUSIBLE, RigInput, RigInputSettings


def feed(rig, readings, name="bit_depth"):
    return [rig.take({name: v}, k * S) for k, v in enumerate(readings, 1)]


def test_readings_become_a_sample_with_a_bit_for_each():
    (sample,) = RigInput().take({"bit_depth": 2214.3, "hookload": 8e5}, 5 * S)
    assert (sample["stamp_ns"], sample["bit_depth"], sample["hookload"], sample["valid"]) == (5 * S, 2214.3, 8e5, 9)


@pytest.mark.fault_case(74)
@pytest.mark.parametrize("depth", [-9999.0, -1.0, 99999.0, math.nan, math.inf])
def test_a_depth_that_cannot_be_is_counted_and_not_given_on(depth):
    rig = RigInput()
    assert rig.take({"bit_depth": depth}, S) is None
    assert rig.counts.refused == 1


@pytest.mark.fault_case(74)
def test_a_jump_of_depth_waits_for_confirmation():
    rig = RigInput()
    out = feed(rig, [1000.0, 1001.0, 2000.0, 1002.0, 2000.0, 2000.1, 2000.2])
    accepted = [None if s is None else float(s["bit_depth"][0]) for s in out]
    assert accepted == [1000.0, 1001.0, None, 1002.0, None, None, 2000.2]
    assert rig.counts.held == 3


def test_a_held_depth_does_not_hold_back_the_rest():
    rig = RigInput()
    rig.take({"bit_depth": 1000.0}, S)
    (sample,) = rig.take({"bit_depth": 5000.0, "pressure": 1e7}, 2 * S)
    assert sample["valid"] == wire.RIG_VALID["pressure"]


@pytest.mark.parametrize("name", list(PLAUSIBLE))
def test_every_other_value_has_bounds(name):
    low, high = PLAUSIBLE[name]
    rig = RigInput()
    for k, bad in enumerate((low - 1.0, high + 1.0, math.nan), 1):
        assert rig.take({name: bad}, k * S) is None
    assert rig.take({name: (low + high) / 2.0}, 9 * S) is not None


def test_a_bit_below_the_bottom_is_not_accepted():
    rig = RigInput()
    (sample,) = rig.take({"bit_depth": 1010.0, "hole_depth": 1000.0, "pressure": 1e7}, S)
    assert sample["valid"] == wire.RIG_VALID["pressure"]


def test_readings_that_come_too_fast_are_counted():
    rig = RigInput(RigInputSettings(max_rate=10.0))
    taken = [rig.take({"pressure": 1e7}, S + k * S // 100) is not None for k in range(100)]
    assert sum(taken) == 10
    assert rig.counts.hurried == 90


def test_slips_follow_from_the_hookload_where_its_limit_is_known():
    rig = RigInput(RigInputSettings(slips_hookload=3e5))
    (light,) = rig.take({"hookload": 1e5}, S)
    (heavy,) = rig.take({"hookload": 9e5}, 2 * S)
    assert (light["in_slips"], heavy["in_slips"]) == (True, False)
    assert light["valid"] & wire.RIG_VALID["in_slips"]


def test_a_name_that_is_not_known_is_not_given_on():
    assert RigInput().take({"mood": 1.0}, S) is None


@pytest.mark.parametrize("ahead_s", [100, 10**6])
def test_a_clock_that_was_ahead_for_a_moment_stops_no_reading_for_long(ahead_s):
    got = RigInput()
    stamps = [*range(10), 10 + ahead_s, *range(10, 20)]
    taken = [got.take({"bit_depth": 1000.0 + 0.1 * at, "hookload": 1e6}, at * S) for at in stamps]
    depths = [sample is not None and bool(sample["valid"][0] & wire.RIG_VALID["bit_depth"]) for sample in taken]
    assert [sample is not None for sample in taken] == 11 * [True] + 2 * [False] + 8 * [True]
    assert depths[-8:] == 8 * [True]


@pytest.mark.parametrize("apart_s", [61, 3600, 10**9])
@pytest.mark.parametrize("block", [1, 2])
def test_of_two_clocks_that_alternate_only_the_later_one_is_taken(apart_s, block):
    got = RigInput()
    for k in range(200):
        later = (k // block) % 2 == 0
        sample = got.take({"bit_depth": 1000.0, "hookload": 1e6 if later else 2e6}, (k if later else k - apart_s) * S)
        assert (sample is not None) is later
