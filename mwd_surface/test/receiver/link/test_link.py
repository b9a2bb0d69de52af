# SPDX-License-Identifier: Apache-2.0
"""A link from samples to surveys, attitude and state: by pulses and by a carrier, however the samples are cut."""

import dataclasses
import math

import numpy as np
import pytest

from mwd_sensors.simulator import carrier_tool
from mwd_sensors.simulator.mud_channel import MudChannel, WellGeometry
from mwd_sensors.simulator.pulse_tool import link_run, transmit
from mwd_sensors.telemetry.downlink import Downlink
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, starting
from mwd_surface.receiver.link.link import DOUBTFUL, LOCKED, NO_FLOW, NO_INPUT, SEARCHING, Link
from mwd_surface.receiver.link.link_attitude import AgeRules
from mwd_surface.receiver.link.link_survey import LinkSurveys

pytestmark = pytest.mark.slow

START_NS = 1_772_345_000_000_000_000
TOOL = ToolConfiguration(
    pulse_width_s=0.5,
    transmit_delay_s=30.0,
    survey_sequences=("Inc:12:P Azm:12:P DipA:12:P Grav:12:P MagF:12:P",),
    toolface_sequences=("aTFA:6:P",),
)
FLOWS = ((60.0, 260.0),)


def link_of(tool=TOOL):
    return Link(tool, tool.link, AgeRules(), lambda s: START_NS + round(s * 1e9))


def pushed(link, time, value, block=100):
    words, surveys, states = [], [], []
    for first in range(0, len(time), block):
        out = link.push(time[first : first + block], value[first : first + block])
        words += out.words
        surveys += out.surveys
        states.append(link.quality())
    return words, surveys, states


@pytest.fixture(scope="module")
def run():
    channel = MudChannel(well=WellGeometry(depth_m=1500.0), flow_off_s=((-100.0, 20.0), (40.0, 60.0)))
    return link_run(channel, transmit(TOOL, FLOWS, 3), 260.0, 3)


def test_a_survey_has_the_time_at_which_the_pumps_were_off(run):
    words, surveys, _ = pushed(link_of(), run.time_s, run.pressure_pa)
    assert len(surveys) == 1
    assert (surveys[0].at.stamp_ns - START_NS) * 1e-9 == pytest.approx(46.0, abs=3.0)
    sent = {(word.frame, word.name): word.raw for word in run.sent.words}
    final = [word for word in words if word.revision]
    assert len(final) >= 8
    assert all(word.raw == sent[word.frame, word.name] for word in final)


def test_the_state_follows_the_pumps_and_the_words(run):
    link = link_of()
    assert link.quality().state == NO_INPUT
    _, _, states = pushed(link, run.time_s, run.pressure_pa)
    by_second = [(state.state, state.reason) for state in states]
    assert by_second[10] == (
        NO_FLOW,
        "the pumps are off, or their flow is below the tool's threshold: the tool is silent",
    )
    assert by_second[70][0] == SEARCHING
    assert "waiting for the sync" in by_second[70][1]
    assert by_second[-1][0] == LOCKED
    assert math.isfinite(states[-1].ebn0_db)
    assert states[-1].toolface_age > 0.0
    assert link.quality(silent=True).state == NO_INPUT


def test_a_flow_below_the_threshold_of_the_tool_is_said(run):
    link = link_of()
    pushed(link, run.time_s[:8500], run.pressure_pa[:8500])
    low = (NO_FLOW, "the flow of 300 l/min is below the tool's threshold of 600 l/min: the tool is silent")
    waiting = (SEARCHING, "waiting for the sync, 30 s after flow-on")
    # The tool, too, takes a flow once it has held for two seconds.
    for at_s, flow, said in ((80.0, 0.5, low), (82.0, 1.5, low), (84.0, 1.5, waiting), (85.0, 0.5, waiting)):
        link.take_flow(at_s, flow * TOOL.flow_threshold)
        assert (link.quality().state, link.quality().reason) == said


@pytest.mark.parametrize(
    ("changes", "begins"),
    [
        ({}, "flow-on"),
        ({"header_bits": 2}, "flow-on or a change of rotation"),
        ({"downlink": Downlink()}, "flow-on or a command"),
    ],
)
def test_pressure_that_begins_behind_the_sync_waits_for_the_next(run, changes, begins):
    link = link_of(dataclasses.replace(TOOL, **changes))
    link.take_flow(110.0, 2.0 * TOOL.flow_threshold)
    _, _, states = pushed(link, run.time_s[11000:13000], run.pressure_pa[11000:13000])
    assert {(one.state, one.reason) for one in states} == {
        (SEARCHING, f"the sync comes after {begins}, and none was seen yet: wait for the next one")
    }


def test_words_refute_a_threshold_that_is_too_high(run):
    link, states = link_of(), []
    for first in range(0, len(run.time_s), 100):
        link.take_flow(run.time_s[first], 0.5 * TOOL.flow_threshold)
        states += pushed(link, run.time_s[first : first + 100], run.pressure_pa[first : first + 100])[-1]
    assert states[70].state == NO_FLOW
    assert states[-1].state == LOCKED


@pytest.mark.parametrize(("words", "state"), [(5, LOCKED), (4, LOCKED), (1, DOUBTFUL)])
def test_a_survey_is_received_when_all_its_words_are_believed(words, state):
    """The pulses end after some words of a tool of surveys only; then its silence is longer than a word."""
    tool, flows = dataclasses.replace(TOOL, toolface_sequences=()), ((60.0, 400.0),)
    channel = MudChannel(well=WellGeometry(depth_m=1500.0), flow_off_s=((-100.0, 20.0), (40.0, 60.0)))
    run, silent = (link_run(channel, transmit(tool, sent, 3), 400.0, 3) for sent in (flows, ()))
    last = run.sent.words[words - 1]
    pressure = np.where(run.time_s < last.end_s + 2.0, run.pressure_pa, silent.pressure_pa)
    _, _, states = pushed(link_of(tool), run.time_s, pressure)
    assert states[-1].state == state
    count = states[-1].reason.split(" of the 5 words")[0]
    if words == 5:
        assert states[-1].reason.startswith("the survey was received")
    else:
        assert 0 <= int(count) <= words
    before = run.time_s[99::100] < last.end_s
    assert not any("the survey was received" in one.reason for one, early in zip(states, before, strict=False) if early)


@pytest.mark.parametrize("here", [0.3, 0.6])
def test_another_pulse_width_in_the_tool_is_named(run, here):
    link = link_of(dataclasses.replace(TOOL, pulse_width_s=here))
    words, _, states = pushed(link, run.time_s, run.pressure_pa)
    assert not [word for word in words if word.usable]
    assert states[-1].state == DOUBTFUL
    assert states[-1].reason.startswith(f"the tool sends pulses of 0.5 s, not of {here:g} s as set here")


def test_another_pulse_width_is_found_at_the_same_time_however_the_samples_are_cut(run):
    other = dataclasses.replace(TOOL, pulse_width_s=0.3)
    _, _, states = pushed(link_of(other), run.time_s, run.pressure_pa)
    found = next(k for k, state in enumerate(states) if state.state == DOUBTFUL)
    for end in (found, found + 1):
        for block in (37, 100 * end):
            link = link_of(other)
            pushed(link, run.time_s[: 100 * end], run.pressure_pa[: 100 * end], block)
            assert link.quality() == states[end - 1]


def test_pumps_of_which_nothing_is_known_are_not_called_off():
    """A voltage does not tell the flow, and a rig need not."""
    carrier = starting("psk")
    link = link_of(dataclasses.replace(carrier, carrier=dataclasses.replace(carrier.carrier, medium="earth")))
    time_s = np.arange(1000) / 100.0
    link.push(time_s, np.random.default_rng(1).standard_normal(1000))
    assert link.quality().state == SEARCHING
    link.take_flow(8.0, 0.0)
    assert link.quality().state == NO_FLOW


def test_any_cut_gives_the_same_words_and_surveys(run):
    whole = pushed(link_of(), run.time_s, run.pressure_pa, len(run.time_s))
    for block in (37, 1000):
        words, surveys, _ = pushed(link_of(), run.time_s, run.pressure_pa, block)
        assert sorted(map(repr, words)) == sorted(map(repr, whole[0]))
        assert surveys == whole[1]


@pytest.mark.parametrize(("rest_s", "listed"), [(6.0, 0), (58.0, 1)])
def test_the_same_codes_are_a_repeat_unless_a_rest_for_another_survey_came_before_them(run, rest_s, listed):
    again = dataclasses.replace(run.sent, pulses=np.vstack([run.sent.pulses, run.sent.pulses + 260.0]))
    channel = MudChannel(
        well=WellGeometry(depth_m=1500.0), flow_off_s=((-100.0, 20.0), (40.0, 60.0), (320.0 - rest_s, 320.0))
    )
    twice = link_run(channel, again, 520.0, 3)
    words, surveys, _ = pushed(link_of(), twice.time_s, twice.pressure_pa)
    assert len([word for word in words if word.name == "Inc" and word.revision]) == 2
    one_list = LinkSurveys((TOOL,), lambda _: None)
    assert [len(one_list.take(heard, 0)) for heard in surveys] == [1, listed]


def test_a_carrier_is_read_by_the_same_link():
    tool = dataclasses.replace(
        starting("psk"), transmit_delay_s=30.0, survey_sequences=TOOL.survey_sequences, toolface_sequences=("aTFA:6:P",)
    )
    channel = MudChannel(well=WellGeometry(depth_m=1500.0), flow_off_s=((-100.0, 60.0),))
    heard = carrier_tool.siren_run(channel, carrier_tool.transmit(tool, FLOWS, 5), 260.0, 5)
    link = link_of(tool)
    words, surveys, states = pushed(link, heard.time_s, heard.pressure_pa)
    assert len(surveys) == 1
    assert [word for word in words if word.name == "aTFA"]
    assert states[-1].state == LOCKED


def test_after_flow_on_the_state_says_nothing_of_before(run):
    again = dataclasses.replace(run.sent, pulses=run.sent.pulses)
    channel = MudChannel(well=WellGeometry(depth_m=1500.0), flow_off_s=((-100.0, 20.0), (40.0, 60.0), (262.0, 300.0)))
    twice = link_run(channel, again, 325.0, 3)
    link = link_of()
    pushed(link, twice.time_s, twice.pressure_pa)
    found = link.quality()
    assert found.state == SEARCHING
    assert np.isnan([found.ebn0_db, found.clock_error, found.word_error]).all()
    assert found.words_done == 0


def test_a_survey_over_a_carrier_is_received_before_another_pass_begins():
    tool = dataclasses.replace(
        starting("psk"), transmit_delay_s=30.0, survey_sequences=TOOL.survey_sequences, toolface_sequences=()
    )
    channel = MudChannel(well=WellGeometry(depth_m=1500.0), flow_off_s=((-100.0, 20.0), (40.0, 60.0)))
    heard = carrier_tool.siren_run(channel, carrier_tool.transmit(tool, FLOWS, 5), 260.0, 5)
    # The last 40 s without a signal, again and again.
    after = np.tile(heard.pressure_pa[heard.time_s >= 220.0], 15)
    time_s = np.arange(len(heard.time_s) + len(after)) * (heard.time_s[1] - heard.time_s[0])
    _, _, states = pushed(link_of(tool), time_s, np.concatenate([heard.pressure_pa, after]))
    assert states[-1].state == LOCKED
    assert states[-1].reason.startswith("the survey was received")
