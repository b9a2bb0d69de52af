# SPDX-License-Identifier: Apache-2.0
"""Faults: each of PX4's words does what it says, for a component or an axis, whatever the block length."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mwd_sensors.core import wire
from mwd_sensors.simulator import faults
from mwd_sensors.simulator.faults import Fault, MessageFaults

N = 1000


def stream(layout=wire.IMU):
    samples = layout.empty(N)
    samples["stamp_ns"] = np.arange(1, N + 1) * 10_000_000
    draw = np.random.default_rng(1).standard_normal((N, 3))
    if layout is wire.IMU:
        samples["angular_velocity"], samples["linear_acceleration"] = draw, draw + np.array([0.0, 0.0, 9.8])
    elif layout is wire.MAG:
        samples["magnetic_field"] = draw * 1e-6 + np.array([2e-5, 0.0, 4e-5])
    else:
        samples["temperature"] = 40.0
    return samples, np.arange(1, N + 1) / 100.0


class Spoilt(NamedTuple):
    """Samples without and with a fault, the times of the latter, s, and which of these lie in the time of the fault."""

    clean: np.ndarray
    whole: np.ndarray
    t: np.ndarray
    hit: np.ndarray


def spoilt(fault, layout=wire.IMU, cuts=()):
    samples, t = stream(layout)
    topic = faults.COMPONENTS[fault.component][0]
    state = faults.start([fault], np.random.default_rng(2))
    parts = [faults.spoil(state, topic, a, b) for a, b in zip(np.split(samples, cuts), np.split(t, cuts), strict=True)]
    whole, t = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Spoilt(samples, whole, t, (t >= 2.0) & (t < 5.0))


WINDOW = {"start_s": 2.0, "seconds": 3.0}


def test_px4s_words_are_there_as_px4_has_them():
    assert faults.PX4 == ("ok", "off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent")
    assert faults.WORDS[:8] == faults.PX4


@pytest.mark.parametrize("word", [w for w in (*faults.PX4, *faults.ELECTRONICS) if w != "ok"])
@pytest.mark.parametrize("component", ["gyro", "mag"])
def test_a_fault_begins_ends_and_does_not_care_about_blocks(word, component):
    layout, fault = wire.MAG if component == "mag" else wire.IMU, Fault(component, word, **WINDOW)
    clean, whole, _, hit = spoilt(fault, layout)
    cut = spoilt(fault, layout, cuts=(1, 7, 150, 203, 204, 480, 777)).whole
    assert whole.tobytes() == cut.tobytes()
    known = clean[np.isin(clean["stamp_ns"], whole[~hit]["stamp_ns"])]
    assert known.tobytes() == whole[~hit].tobytes()
    assert whole.tobytes() != clean.tobytes()


def test_ok_is_ok_and_other_fields_are_left_alone():
    clean, whole, *_ = spoilt(Fault("gyro", "ok"))
    assert whole.tobytes() == clean.tobytes()
    clean, whole, *_ = spoilt(Fault("gyro", "garbage", **WINDOW))
    assert np.array_equal(whole["linear_acceleration"], clean["linear_acceleration"])


def test_off_stops_a_message_or_says_not_reported():
    clean, whole, _, hit = spoilt(Fault("mag", "off", **WINDOW), wire.MAG)
    assert len(whole) == len(clean) - 300
    assert not hit.any()
    _, whole, _, hit = spoilt(Fault("accel", "off", **WINDOW))
    assert len(whole) == N
    assert np.all(whole["linear_acceleration"][hit] == 0.0)
    # REP-145: first element -1 means that the quantity is not reported.
    assert np.all(whole["linear_acceleration_covariance"][hit, 0] == -1.0)
    assert np.all(whole["angular_velocity_covariance"] == 0.0)


def test_stuck_keeps_the_last_good_value_of_its_axis():
    clean, whole, _, hit = spoilt(Fault("accel", "stuck", "y", **WINDOW))
    last = clean["linear_acceleration"][np.flatnonzero(hit)[0] - 1, 1]
    assert np.all(whole["linear_acceleration"][hit, 1] == last)
    assert np.array_equal(whole["linear_acceleration"][:, [0, 2]], clean["linear_acceleration"][:, [0, 2]])


def test_garbage_fills_the_range_and_wrong_looks_reasonable():
    _, whole, _, hit = spoilt(Fault("accel", "garbage", **WINDOW))
    assert np.abs(whole["linear_acceleration"][hit]).max() > 100.0
    clean, whole, *_ = spoilt(Fault("accel", "wrong", **WINDOW))
    off = (whole["linear_acceleration"] - clean["linear_acceleration"])[hit]
    assert 0.05 < np.abs(off).mean() < 1.0


def test_slow_is_a_tenth_of_the_rate_and_intermittent_comes_and_goes():
    assert spoilt(Fault("gyro", "slow", **WINDOW)).hit.sum() == 30
    t = spoilt(Fault("gyro", "intermittent", start_s=0.0)).t
    assert 200 < len(t) < 800
    assert np.sum(np.diff(t) > 0.1) >= 3


def test_delayed_values_are_as_old_as_asked():
    clean, whole, _, hit = spoilt(Fault("gyro", "delayed", delay_s=0.5, **WINDOW))
    hit = np.flatnonzero(hit)
    assert_allclose(whole["angular_velocity"][hit], clean["angular_velocity"][hit - 50])


AXIS_OF = {"swapped": "xz", "turned": "z"}


@pytest.mark.parametrize("word", faults.MOUNTING)
def test_a_tool_put_together_wrongly_gives_other_axes_or_units_in_any_blocks(word):
    component = {"in_g": "accel", "in_deg_s": "gyro"}.get(word, "mag")
    layout = wire.MAG if component == "mag" else wire.IMU
    fault = Fault(component, word, AXIS_OF.get(word, "all"), **WINDOW)
    faults.check(fault)
    clean, whole, _, hit = spoilt(fault, layout)
    assert whole.tobytes() == spoilt(fault, layout, cuts=(1, 7, 250, 480)).whole.tobytes()
    field = faults.COMPONENTS[component][1]
    assert np.array_equal(whole[field][~hit], clean[field][~hit])
    factors = {"in_g": 1 / 9.80665, "in_deg_s": 180 / np.pi, "in_ut": 1e6, "in_mt": 1e3, "in_gauss": 1e4, "in_nt": 1e9}
    was, became = clean[field][hit], whole[field][hit]
    if word in factors:
        assert_allclose(became, was * factors[word], rtol=1e-12)
    elif word == "swapped":
        assert_allclose(became, was[:, [2, 1, 0]])
    elif word == "flipped":
        assert_allclose(became, -was)
    else:
        # A quarter about z: what lay along x lies along y.
        assert_allclose(became, np.column_stack([-was[:, 1], was[:, 0], was[:, 2]]))


def test_one_axis_can_be_flipped_not_a_number_or_at_the_end_of_its_range():
    def forces(word, axis):
        clean, whole, _, hit = spoilt(Fault("accel", word, axis, **WINDOW))
        return clean["linear_acceleration"][hit], whole["linear_acceleration"][hit]

    clean, flipped = forces("flipped", "y")
    assert_allclose(flipped, clean * [1.0, -1.0, 1.0])
    _, unknown = forces("nan", "z")
    assert np.array_equal(np.isnan(unknown).any(axis=0), [False, False, True])
    assert np.isnan(unknown[:, 2]).all()
    assert_allclose(np.abs(forces("saturated", "x")[1][:, 0]), 16.0 * 9.80665)


def test_repeated_stamps_come_in_pairs():
    _, whole, t, hit = spoilt(Fault("gyro", "repeated_stamps", **WINDOW))
    steps = np.diff(whole["stamp_ns"][hit])
    assert np.count_nonzero(steps == 0) == 150
    assert np.all(np.diff(whole["stamp_ns"][t >= 5.0]) > 0)


@pytest.mark.parametrize(
    ("fault", "word"),
    [
        (Fault("gyro", "in_g"), "in_deg_s"),
        (Fault("accel", "in_g", "x"), "all axes"),
        (Fault("accel", "swapped"), "two axes"),
        (Fault("accel", "flipped", "xy"), "two axes"),
        (Fault("mag", "turned"), "the axis of the turn"),
        (Fault("temperature", "flipped"), "no other unit"),
        (Fault("temperature", "stuck", "x"), "no axes"),
        (Fault("gyro", "delayed", "x"), "whole messages"),
    ],
)
def test_a_fault_that_cannot_be_is_refused(fault, word):
    with pytest.raises(ValueError, match=word):
        faults.check(fault)


def carried(link, cuts=()):
    samples, t = stream()
    state = faults.start_link(link, np.random.default_rng(3))
    parts = [faults.carry(state, a, b) for a, b in zip(np.split(samples, cuts), np.split(t, cuts), strict=True)]
    return samples, np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def test_a_perfect_link_changes_nothing():
    clean, arrived, _ = carried(MessageFaults())
    assert arrived.tobytes() == clean.tobytes()


@pytest.mark.parametrize(
    "link",
    [
        MessageFaults(loss=0.1),
        MessageFaults(duplicates=0.1),
        MessageFaults(reorder=0.1),
        MessageFaults(burst_every_s=2.0),
        MessageFaults(0.05, 3.0, 0.5, 0.05, 0.05),
    ],
)
def test_a_poor_link_does_not_care_about_blocks(link):
    _, whole, t = carried(link)
    _, cut, _ = carried(link, (3, 4, 500))
    assert whole.tobytes() == cut.tobytes()
    assert np.all(np.diff(t) >= 0.0)


def test_samples_are_lost_doubled_and_swapped_in_the_asked_shares():
    assert len(carried(MessageFaults(loss=0.1))[1]) == pytest.approx(900, abs=35)
    assert len(carried(MessageFaults(duplicates=0.1))[1]) == pytest.approx(1100, abs=35)
    clean, arrived, _ = carried(MessageFaults(reorder=0.1))
    back = np.sum(np.diff(arrived["stamp_ns"]) < 0)
    assert back == pytest.approx(90, abs=30)
    assert len(np.unique(arrived["stamp_ns"])) >= len(clean) - 1
    stamps = carried(MessageFaults(burst_every_s=2.0, burst_s=0.5))[1]["stamp_ns"]
    assert np.diff(stamps).max() == pytest.approx(0.51e9, abs=1e7)


def test_the_clock_jumps_once():
    link = dataclasses.replace(MessageFaults(), clock_jump_at_s=5.0, clock_jump_s=-2.0)
    samples, t = stream()
    stamps = faults.jumped(link, samples["stamp_ns"], t)
    off = (stamps - samples["stamp_ns"]) / 1e9
    assert np.all(off[t < 5.0] == 0.0)
    assert np.all(off[t >= 5.0] == -2.0)


def test_the_guide_explains_every_word():
    guide = (Path(__file__).resolve().parents[3] / "docs" / "guide" / "simulator.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`[^|]+) \|", guide[guide.index("| word | effect |") :], re.MULTILINE)
    assert sorted(re.findall(r"`(\w+)`", " ".join(rows))) == sorted(faults.WORDS)
