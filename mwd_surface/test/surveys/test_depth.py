# SPDX-License-Identifier: Apache-2.0
"""Depth of a survey from what a rig reports: pairing by time, placeholders, jumps, silences, corrections by hand."""

import csv
import datetime as dt
import gzip
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_surface.surveys.depth import DepthRules, DepthTrack
from project import REFERENCE_DATA

S = 10**9
F7 = REFERENCE_DATA / "volve" / "F-7_rig_surface_15s.csv.gz"


def track(*readings, **rules):
    got = DepthTrack(DepthRules(**rules))
    for seconds, depth in readings:
        got.update(int(seconds * S), depth)
    return got


def test_a_survey_between_two_readings_lies_on_the_line_and_carries_the_age_of_the_nearer():
    got = track((0, 1000.0), (10, 1004.0)).sensor_depth(8 * S, 12.5)
    assert got.bit_depth == pytest.approx(1003.2)
    assert got.measured_depth == pytest.approx(990.7)
    assert got.depth_age == pytest.approx(2.0)


def test_a_survey_after_the_last_reading_takes_it_with_its_age():
    got = track((0, 1000.0)).sensor_depth(45 * S, 10.0)
    assert (got.measured_depth, got.depth_age) == (990.0, 45.0)


def test_a_long_silence_is_not_bridged():
    got = track((0, 1000.0), (600, 1030.0)).sensor_depth(590 * S, 0.0)
    assert (got.measured_depth, got.depth_age) == (1000.0, 590.0)


def test_before_the_first_reading_depth_is_taken_from_nearby_or_unknown():
    got = track((100, 1000.0))
    assert got.sensor_depth(95 * S, 0.0).measured_depth == 1000.0
    far = got.sensor_depth(0, 0.0)
    assert math.isnan(far.measured_depth)
    assert math.isnan(far.depth_age)
    assert far.reason == "the first depth reading came 100 s after the survey"
    assert "no depth from the rig yet" in DepthTrack().sensor_depth(0, 0.0).reason


@pytest.mark.parametrize("null", [-999.25, -9999.0, math.nan, math.inf, 1e30, -0.01])
def test_a_placeholder_is_counted_and_not_used(null):
    got = track((0, 1000.0))
    assert not got.update(S, null)
    assert not got.update(2 * S, 0.0, valid=False)
    assert got.refused_null == 2
    assert got.latest == (0, 1000.0)


def test_a_spike_is_ignored_and_a_confirmed_jump_is_accepted_from_its_first_reading():
    got = track((0, 1000.0), (1, 0.0), (2, 1000.2))
    assert got.refused_jump == 1
    assert got.sensor_depth(S, 0.0).measured_depth == pytest.approx(1000.1)
    got = track((0, 1000.0), (1, 1500.0), (2, 1500.1), (3, 1500.2))
    assert got.latest == (3 * S, 1500.2)
    assert got.sensor_depth(1 * S, 0.0).measured_depth == 1500.0


def test_spikes_that_do_not_agree_confirm_nothing():
    got = track((0, 1000.0), (1, 0.0), (2, 5000.0), (3, 200.0), (4, 1000.4))
    assert got.latest == (4 * S, 1000.4)
    assert got.refused_jump == 3


def test_readings_out_of_order_are_counted():
    got = track((10, 1000.0), (5, 999.0), (10, 1000.0))
    assert got.refused_order == 2


def test_a_person_sets_the_depth_against_what_the_rig_reported():
    got = track((0, 1000.0), (10, 1000.0), (20, 1000.0))
    got.set_by_hand(15 * S, 1034.0)
    assert got.sensor_depth(16 * S, 4.0).measured_depth == 1030.0
    assert got.sensor_depth(16 * S, 4.0).by_hand
    # No line is drawn from the old reading to the correction.
    assert got.sensor_depth(14 * S, 0.0).measured_depth == 1000.0
    assert not got.update(17 * S, 1000.0)
    assert got.update(18 * S, 1034.1)
    with pytest.raises(ValueError, match="bit_depth: must be within 0 and 20000 m, got -3"):
        got.set_by_hand(0, -3.0)


def test_a_sensor_above_the_datum_has_no_depth_and_says_why():
    got = track((0, 5.0)).sensor_depth(0, 12.0)
    assert math.isnan(got.measured_depth)
    assert got.reason == "bit at 5.00 m: the sensor is still above the datum"
    with pytest.raises(ValueError, match="sensor_to_bit"):
        track((0, 5.0)).sensor_depth(0, math.nan)


@pytest.mark.fault_case(70)
def test_history_is_bounded():
    got = track(*((k, 1000.0 + 0.01 * k) for k in range(500)), history=100)
    assert got.sensor_depth(499 * S, 0.0).measured_depth == pytest.approx(1004.99)
    assert got.sensor_depth(0, 0.0).reason.startswith("the first depth reading came")


@given(
    st.lists(st.tuples(st.integers(-5, 200), st.floats()), max_size=40), st.integers(-100, 300), st.floats(0.0, 50.0)
)
def test_whatever_the_rig_sends_a_depth_is_finite_and_not_negative_or_unknown_with_a_reason(readings, at, offset):
    got = track(*readings).sensor_depth(at * S, offset)
    assert math.isnan(got.measured_depth) or 0.0 <= got.measured_depth < math.inf
    assert math.isfinite(got.measured_depth) != bool(got.reason)


def alternating(*blocks):
    """Readings once a second, in turns from two sources; blocks: (count, depth)."""
    readings, k = [], 0
    for count, depth in blocks:
        for _ in range(count):
            readings.append((k, depth + 0.005 * k))
            k += 1
    return track(*readings), k


@pytest.mark.parametrize("blocks", [[(1, 1000.0), (1, 1250.0)] * 10, [(4, 1000.0), (4, 1250.0)] * 4])
def test_two_sources_that_alternate_give_no_depth_and_are_named(blocks):
    got, end = alternating(*blocks)
    reading = got.sensor_depth((end - 2) * S, 10.0)
    assert math.isnan(reading.measured_depth)
    assert reading.reason.startswith("two sources of depth alternate, 1")
    assert " 1000." in reading.reason or " 1250." in reading.reason
    # A person's word ends it, and so does one source that falls silent.
    got.set_by_hand((end + 1) * S, 1260.0)
    assert got.sensor_depth((end + 2) * S, 10.0).measured_depth == 1250.0


def test_two_sources_with_the_same_stamps_give_no_depth_and_are_named():
    readings = [(k, depth + 0.005 * k) for k in range(20) for depth in (1000.0, 1250.0)]
    reading = track(*readings).sensor_depth(18 * S, 10.0)
    assert math.isnan(reading.measured_depth)
    assert reading.reason.startswith("two sources of depth alternate, 1000.1 m and 1250.1 m")
    # One source that sends its readings twice is one source.
    doubled = [(k, 1000.0 + 0.005 * k) for k in range(20) for _ in range(2)]
    assert track(*doubled).sensor_depth(18 * S, 10.0).measured_depth == pytest.approx(990.09)


def test_one_source_after_two_is_trusted_again_after_a_while():
    got, end = alternating(*[(1, 1000.0), (1, 1250.0)] * 10)
    for k in range(end, end + 130):
        got.update(k * S, 1000.0 + 0.005 * k)
    assert got.sensor_depth((end + 100) * S, 10.0).measured_depth == pytest.approx(990.6)


@pytest.mark.parametrize("spikes", [[0.0] * 6, [4000.0, 300.0, 7000.0, 50.0, 2500.0, 9000.0]])
def test_placeholders_of_zero_and_wild_spikes_are_no_second_source(spikes):
    readings = [(2 * k, 1000.0) for k in range(len(spikes) + 1)] + [(2 * k + 1, s) for k, s in enumerate(spikes)]
    assert track(*sorted(readings)).sensor_depth(6 * S, 0.0).measured_depth == pytest.approx(1000.0)


@pytest.mark.parametrize(("apart", "says"), [(120.0, "119 s ahead of"), (-3600.0, "3601 s behind"), (5.0, "")])
def test_clocks_of_rig_and_sonde_that_differ_are_named_by_the_order_of_arrival(apart, says):
    got = DepthTrack()
    for k in range(300):
        got.note_sonde(k * S)
        # The rig's data come a second late.
        got.update(int((k - 1.0 + apart) * S), 1000.0)
    reading = got.sensor_depth(int((200.0 + max(apart, 0.0)) * S), 0.0)
    assert says in reading.reason
    assert bool(reading.reason) == bool(says) == math.isnan(reading.measured_depth)


def test_a_sonde_that_starts_anew_does_not_accuse_the_rig():
    got = DepthTrack()
    for k in range(100):
        got.note_sonde((10_000 if k < 20 else 0) * S + k * S)
        got.update(k * S, 1000.0)
    assert got.sensor_depth(90 * S, 0.0).measured_depth == 1000.0


def test_a_real_rigs_day_pairs_every_reading_with_itself():
    """Volve 15/9-F-7, 15 s rig data; its bit depth dips below zero while the pipe is out of the hole."""
    got, accepted = DepthTrack(), {}
    with gzip.open(F7, "rt") as file:
        for row in csv.DictReader(file):
            at = dt.datetime.fromisoformat(row["Time[unitless]"])
            stamp = int(at.timestamp()) * S
            if got.update(stamp, float(row["BITDEP[m]"])):
                accepted[stamp] = float(row["BITDEP[m]"])
    assert len(accepted) > 9000
    assert got.refused_jump < 10
    for stamp, depth in list(accepted.items())[::97]:
        assert got.sensor_depth(stamp, 0.0).measured_depth == depth


@pytest.mark.parametrize("ahead_s", [70, 3600, 10**8])
@pytest.mark.parametrize("wrong", [1, 2, 50])
def test_stamps_of_the_future_stop_no_depth_for_longer_than_readings_take_to_confirm_the_time(ahead_s, wrong):
    got = track(*((k, 1000.0 + 0.1 * k) for k in range(100)))
    for k in range(wrong):
        got.update((100 + ahead_s + k) * S, 1010.0)
    accepted = [got.update((101 + k) * S, 1010.1 + 0.1 * k) for k in range(10)]
    assert accepted == [False, False] + 8 * [True]
    assert got.latest == (110 * S, pytest.approx(1011.0))
    assert got.sensor_depth(101 * S, 0.0).measured_depth == pytest.approx(1010.1)


@given(back_s=st.integers(61, 10**8), seed=st.randoms(use_true_random=False))
def test_single_readings_of_the_past_change_nothing(back_s, seed):
    plain, disturbed = track(), track()
    for k in range(60):
        plain.update(k * S, 1000.0 + 0.1 * k)
        disturbed.update(k * S, 1000.0 + 0.1 * k)
        if seed.random() < 0.3:
            for late in range(seed.choice([1, 2])):
                assert not disturbed.update((k - back_s + late) * S, 1000.0)
    assert disturbed.latest == plain.latest
    assert disturbed.sensor_depth(30 * S, 0.0) == plain.sensor_depth(30 * S, 0.0)


@pytest.mark.parametrize("burst", [3, 10, 50])
def test_a_burst_of_a_clock_of_the_past_removes_no_depths_before_a_sonde_is_heard(burst):
    got = track(*((k, 1000.0 + 0.1 * k) for k in range(100)))
    assert not any(got.update((k - 10**6) * S, 500.0) for k in range(burst))
    assert got.update(101 * S, 1010.1)
    assert got.sensor_depth(50 * S, 0.0).bit_depth == pytest.approx(1005.0)


def test_a_clock_that_is_set_back_for_good_gives_depths_again_within_the_bridge():
    got = track(*((k, 1000.0 + 0.1 * k) for k in range(100)))
    accepted = [got.update((k - 10**6) * S, 1010.0) for k in range(100)]
    assert accepted == 60 * [False] + 40 * [True]


@pytest.mark.parametrize("other_s", [-(10**9), -3600, -120])
@pytest.mark.parametrize("block", [3, 50])
def test_readings_of_a_clock_farther_from_that_of_the_sonde_remove_no_depths(other_s, block):
    got = DepthTrack()
    for k in range(600):
        got.note_sonde(k * S)
        mine = (k // block) % 2 == 0
        assert got.update((k if mine else k + other_s) * S, 1000.0 + 0.1 * k if mine else 500.0) is mine
    for at in (0, 2 * block, 6 * block + 1):
        assert got.sensor_depth(at * S, 0.0).bit_depth == pytest.approx(1000.0 + 0.1 * at)


def test_a_clock_that_is_set_back_to_that_of_the_sonde_gives_depths_again():
    got = track(*((k + 3600, 1000.0) for k in range(100)))
    accepted = []
    for k in range(100, 110):
        got.note_sonde(k * S)
        accepted.append(got.update(k * S, 1000.0))
    assert accepted == [False, False] + 8 * [True]
