# SPDX-License-Identifier: Apache-2.0
"""The receiver of a carrier: near the coded limit in white noise, any cut, and what must not be believed."""

import dataclasses
import re

import numpy as np
import pytest
from carrier_runs import RATE_HZ, block_errors, decoded, tool_of, white

import telemetry_limits as limits
from mwd_sensors.simulator.carrier_tool import siren_run, transmit
from mwd_sensors.simulator.mud_channel import MudChannel, Pump, WellGeometry
from mwd_sensors.telemetry.tool_configuration import starting
from mwd_surface.receiver.carrier.carrier_receiver import CarrierReceiver

pytestmark = pytest.mark.slow

TOOL = tool_of()


@pytest.mark.parametrize(
    ("modulation", "ebn0_db"), [("qpsk", 3.0), pytest.param("bpsk", 3.0, marks=pytest.mark.nightly), ("dpsk", 6.0)]
)
def test_block_errors_in_white_noise_are_within_a_third_of_a_decibel_of_the_limit(modulation, ebn0_db):
    tool = tool_of(modulation)
    errors = []
    for seed in range(3):
        sent, time, value = white(tool, 24, ebn0_db, seed, clock=1e-3 * (-1) ** seed)
        errors += block_errors(sent, decoded(tool, time, value)[0].words)
    assert len(errors) == 72
    expected = limits.coded_block_error(ebn0_db - 0.3, 64, modulation)
    assert np.mean(errors) < expected + 3.0 * np.sqrt(expected / len(errors))


@pytest.mark.parametrize("clock", [-1e-3, 1e-3])
def test_a_clock_that_is_off_is_followed(clock):
    sent, time, value = white(TOOL, 8, 8.0, clock=clock)
    got, _ = decoded(TOOL, time, value)
    assert not any(block_errors(sent, got.words))
    assert got.frames[-1].clock_error == pytest.approx(clock, abs=3e-5)
    assert got.frames[0].ebn0_db == pytest.approx(8.0, abs=1.0)
    assert [word.index for word in got.words if word.frame == 0] == list(range(7))


def test_any_cut_gives_the_same_words():
    _, time, value = white(TOOL, 6, 6.0)
    whole, _ = decoded(TOOL, time, value)
    receiver = CarrierReceiver(TOOL)
    cuts = np.sort(np.random.default_rng(4).integers(0, len(time), 60))
    words = []
    for t, v in zip(np.split(time, cuts), np.split(value, cuts), strict=True):
        words += receiver.push(t, v).words
    assert words + receiver.finish().words == whole.words


def test_nothing_is_believed_in_noise_and_the_reason_is_said():
    random = np.random.default_rng(7)
    time = np.arange(0.0, 1200.0, 1.0 / RATE_HZ)
    got, receiver = decoded(TOOL, time, np.cumsum(random.normal(size=len(time))) + 5.0 * random.normal(size=len(time)))
    assert not [word for word in got.words if word.status == "believed"]
    assert "no words: " in receiver.why_nothing()


@pytest.mark.parametrize("ebn0_db", [-4.0, -8.0])
def test_a_weak_signal_is_named_as_a_possible_reason(ebn0_db):
    got, receiver = decoded(TOOL, *white(TOOL, 6, ebn0_db)[1:])
    assert not got.words
    assert "too weak" in receiver.why_nothing()


def test_another_table_of_words_is_not_believed():
    _, time, value = white(TOOL, 6, 12.0)
    other = dataclasses.replace(TOOL, survey_sequences=("Inc:12 Azm:12 DipA:12 Temp:8 Grav:12 MagF:12 BatV:9",))
    got, receiver = decoded(other, time, value)
    assert not got.words
    assert "other sequences" in receiver.why_nothing()


def test_a_tool_that_begins_anew_is_heard_from_its_first_block_on():
    first, second = TOOL.transmit_delay_s, 130.0
    sent = transmit(TOOL, ((0.0, 100.0), (second, 260.0)), 5)
    time = np.arange(0.0, 265.0, 1.0 / RATE_HZ)
    value = sent.drive(time) + 0.5 * np.random.default_rng(1).normal(size=len(time))
    got, _ = decoded(TOOL, time, value)
    surveys = [frame for frame in got.frames if frame.kind == "survey"]
    assert [frame.start_s for frame in surveys] == pytest.approx([first, second + first], abs=0.1)
    assert not any(block_errors(sent, got.words))


def test_a_gap_costs_its_own_blocks_only():
    sent, time, value = white(TOOL, 8, 8.0)
    kept = (time < 100.0) | (time > 125.0)
    got, _ = decoded(TOOL, time[kept], value[kept])
    assert sum(block_errors(sent, got.words)) <= 2


def test_a_siren_is_read_beside_pumps_whose_harmonic_is_on_its_carrier():
    """1.5 strokes a second: the eighth harmonic is 12 Hz."""
    tool = dataclasses.replace(starting("psk"), transmit_delay_s=30.0)
    sent = transmit(tool, ((20.0, 330.0),), 2)
    channel = MudChannel(
        well=WellGeometry(depth_m=3000.0), pumps=(Pump(1.5, leak=0.05), Pump(1.53)), flow_off_s=((-100.0, 20.0),)
    )
    run = siren_run(channel, sent, 340.0, 2)
    got, _ = decoded(tool, run.time_s, run.pressure_pa)
    late = got.words[0].start_s - sent.words[0].start_s
    assert 1.0 < late < 4.0
    shifted = [dataclasses.replace(word, start_s=word.start_s - late) for word in got.words]
    assert np.mean(block_errors(sent, shifted)) < 0.15


@pytest.mark.parametrize(
    ("counted", "said"), [(True, r"harmonic 3 of pump [12] \(4\.\d+ Hz\) is on"), (False, r"a line of 4\.\d+ Hz is on")]
)
def test_a_pump_s_harmonic_on_a_carrier_that_is_not_heard_is_named(counted, said):
    tool = tool_of(frequency_hz=4.0, symbol_rate_hz=1.25, medium="mud")
    channel = MudChannel(
        well=WellGeometry(depth_m=9000.0), pumps=(Pump(1.45), Pump(1.335, leak=0.2)), flow_off_s=((-100.0, 20.0),)
    )
    run = siren_run(channel, transmit(tool, ((20.0, 190.0),), 2), 200.0, 2)
    receiver = CarrierReceiver(tool)
    for pump, times in enumerate(run.strokes_s if counted else ()):
        receiver.strokes(pump + 1, times)
    words = receiver.push(run.time_s, run.pressure_pa).words + receiver.finish().words
    assert not words
    assert re.match(rf"no words: {said} the carrier; ", receiver.why_nothing())


def test_a_line_is_not_told_of_once_it_cannot_be_judged():
    """A line, then a gauge that gives every other half second: the line may have gone."""
    tool = tool_of(frequency_hz=4.0, symbol_rate_hz=1.25, medium="mud")
    time = np.arange(0.0, 300.0, 1.0 / RATE_HZ)
    value = 1e5 * np.sin(2.0 * np.pi * 4.2 * time) + np.random.default_rng(1).normal(size=len(time))
    kept = (time < 150.0) | (time % 1.0 < 0.5)
    receiver = CarrierReceiver(tool)
    receiver.push(time[time < 150.0], value[time < 150.0])
    assert "a line of 4.20 Hz is on the carrier" in receiver.why_nothing()
    late = kept & (time >= 150.0)
    receiver.push(time[late], value[late])
    assert "on the carrier" not in receiver.why_nothing()


def test_samples_too_far_apart_are_refused():
    time = np.arange(0.0, 300.0, 0.05)
    with pytest.raises(ValueError, match=r"20 samples a second; a carrier of 12 Hz needs"):
        decoded(TOOL, time, np.sin(time))


def test_a_block_that_noise_has_hit_is_erased_however_sure_its_bits_are():
    """A spike of a thousand times the noise within one block: the code claims its bits, the check refuses them."""
    sent, time, value = white(TOOL, 6, 12.0)
    place = (time > 80.0) & (time < 88.0)
    value[place] += 3e5 * np.sin(2.0 * np.pi * 12.3 * time[place])
    got, _ = decoded(TOOL, time, value)
    right = {(word.name, word.raw) for word in sent.words}
    assert all((word.name, word.raw) in right for word in got.words if word.status == "believed")
    assert 1 <= sum(block_errors(sent, got.words)) <= 2


def test_a_tool_of_surveys_only_is_read_at_each_flow_on_and_nothing_between():
    tool = dataclasses.replace(tool_of(), toolface_sequences=())
    sent, _, value = white(tool, 8, 10.0)
    again = np.concatenate([value, value])
    words, _ = decoded(tool, np.arange(len(again)) / RATE_HZ, again)
    assert [word.raw for word in words.words if word.status == "believed"] == 2 * [word.raw for word in sent.words]
