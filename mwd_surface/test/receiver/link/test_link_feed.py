# SPDX-License-Identifier: Apache-2.0
"""A link fed with bursts: stamps to times, pressure waits for its strokes, a clock that is set begins anew."""

import dataclasses
import itertools
import math
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mwd_sensors.simulator import serial_channel
from mwd_sensors.simulator.mud_channel import MudChannel, Pump, WellGeometry
from mwd_sensors.simulator.pulse_tool import link_run, transmit
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, starting
from mwd_surface.receiver.link.link import NO_FLOW, SEARCHING, LinkOutput
from mwd_surface.receiver.link.link_attitude import AgeRules
from mwd_surface.receiver.link.link_feed import FollowingLink, LinkFeed
from mwd_surface.receiver.pulse.pulse_receiver import decode
from mwd_surface.receiver.words import BELIEVED

SECOND = 10**9
START = 1_772_345_000 * SECOND
PRESSURE = np.full(100, 2.0e7)


def feed_of(tool=None):
    warnings = []
    return LinkFeed(tool or ToolConfiguration(), AgeRules(), warnings.append), warnings


def test_pressure_is_used_at_once_where_no_strokes_are_counted():
    feed, _ = feed_of()
    for k in range(3):
        feed.push(START + k * SECOND, 0.01, PRESSURE)
        assert feed.link.now_s == pytest.approx(k + 0.99)
    assert feed.stamp_of(feed.link.now_s) == START + 2_990_000_000


def test_pressure_waits_for_the_strokes_up_to_its_end_but_not_for_a_counter_that_failed():
    wall = [0.0]
    feed = LinkFeed(ToolConfiguration(), AgeRules(), pytest.fail, lambda: wall[0])
    feed.push(START, 0.01, PRESSURE)
    feed.take_strokes(START + SECOND, [(1, START + SECOND // 2)])
    feed.push(START + SECOND, 0.01, PRESSURE)
    assert feed.link.now_s == pytest.approx(0.99)
    feed.take_strokes(START + 2 * SECOND, [])
    assert feed.link.now_s == pytest.approx(1.99)
    # Bursts that come all at once, as after a pause of the network, do not say that the counter has failed.
    for k in range(2, 16):
        feed.push(START + k * SECOND, 0.01, PRESSURE)
    assert feed.link.now_s == pytest.approx(1.99)
    wall[0] = 11.0
    feed.push(START + 16 * SECOND, 0.01, PRESSURE)
    assert feed.link.now_s == pytest.approx(16.99)
    feed.push(START + 17 * SECOND, 0.01, PRESSURE)
    assert feed.link.now_s == pytest.approx(17.99)
    # A counter that works again is waited for again.
    feed.take_strokes(START + 18 * SECOND, [])
    feed.push(START + 18 * SECOND, 0.01, PRESSURE)
    assert feed.link.now_s == pytest.approx(17.99)
    feed.finish()
    assert feed.link.now_s == pytest.approx(18.99)


@pytest.fixture(scope="module")
def counted():
    """A tool, and two minutes of its pressure with the strokes of an uneven pump, as bursts of a second."""
    tool = ToolConfiguration(
        pulse_width_s=0.5,
        transmit_delay_s=20.0,
        survey_sequences=("Inc:12:P Azm:12:P",),
        toolface_sequences=("aTFA:6:P",),
    )
    channel = MudChannel(
        well=WellGeometry(depth_m=800.0),
        pumps=(Pump(strokes_hz=1.45), Pump(strokes_hz=1.52, imbalance=0.02)),
        flow_off_s=((-100.0, 10.0),),
    )
    run = link_run(channel, transmit(tool, ((10.0, 120.0),), 3), 120.0, 3)
    bursts, counts = [], []
    for k in range(120):
        bursts.append((START + k * SECOND, 0.01, run.pressure_pa[100 * k : 100 * (k + 1)]))
        strokes = [
            (pump, START + round(at * SECOND))
            for pump, times in enumerate(run.strokes_s, 1)
            for at in times
            if k < at <= k + 1
        ]
        counts.append((START + (k + 1) * SECOND, sorted(strokes, key=lambda one: one[1])))
    return tool, bursts, counts


def fed(tool, steps):
    """Final words of a feed that takes steps: bursts and counts, in order; a clock that never moves on."""
    feed = LinkFeed(tool, AgeRules(), pytest.fail, lambda: 0.0)
    words = []
    for step in steps:
        words += (feed.push(*step) if len(step) == 3 else feed.take_strokes(*step)).words
    return [word for word in words + feed.finish().words if word.revision]


@pytest.mark.slow
def test_words_do_not_depend_on_how_strokes_and_pressure_arrive(counted):
    tool, bursts, counts = counted
    strokes = [(pump, at) for _, some in counts for pump, at in some]
    by_pump = {pump: np.array([(at - START) / SECOND for one, at in strokes if one == pump]) for pump in (1, 2)}
    time = np.concatenate([(start - START) / SECOND + step * np.arange(len(values)) for start, step, values in bursts])
    decoded = decode(tool, time, np.concatenate([values for _, _, values in bursts]), by_pump).words
    assert len([word for word in decoded if word.status == BELIEVED]) > 5
    pairs = list(zip(bursts, counts, strict=True))
    in_time = [step for pair in pairs for step in pair]
    # At the end of a run, or behind a pause of the network, many bursts are taken before the first of their strokes.
    together = in_time[:160] + [burst for burst, _ in pairs[80:]] + [count for _, count in pairs[80:]]
    ahead = counts[:40] + [step for k in range(80) for step in (bursts[k], counts[k + 40])] + bursts[80:]
    for steps in (in_time, together, ahead):
        assert fed(tool, steps) == decoded
    assert fed(tool, bursts) != decoded


def test_a_backlog_has_each_state_between():
    """Pumps off for ten seconds in a minute that waited for its strokes, and is then used at once."""
    feed, _ = feed_of()
    feed.take_strokes(START, [])
    for k in range(60):
        flowing = not 20 <= k < 30
        assert not feed.push(START + k * SECOND, 0.01, PRESSURE if flowing else 0.01 * PRESSURE).states
    states = feed.take_strokes(START + 60 * SECOND, []).states
    # A second is judged once the next one begins.
    changes = [(0, SEARCHING), (21, NO_FLOW), (31, SEARCHING)]
    found = itertools.groupby(states, lambda row: row[1].state)
    assert [(int(next(rows)[0]), state) for state, rows in found] == changes


def times_used(feed, starts):
    """The times of the first sample of each burst of a second that reaches the link, s from START."""
    used = []

    def push(_, time_s, __):
        used.append(round((feed.stamp_of(float(time_s[0])) - START) / SECOND))
        return LinkOutput()

    with mock.patch.object(FollowingLink, "push", push):
        for at in starts:
            feed.push(START + at * SECOND, 0.01, PRESSURE)
    return used


def test_a_clock_that_goes_back_begins_anew_with_a_word():
    feed, warnings = feed_of()
    assert times_used(feed, [0, 1, -60, -59, -58]) == [0, 1, -60, -59, -58]
    assert len(warnings) == 1
    assert "back" in warnings[0]
    assert feed.stamp_of(0.0) == START - 60 * SECOND


@pytest.mark.fault_case(43)
def test_a_gap_of_hours_begins_anew_instead_of_being_filled():
    feed, warnings = feed_of()
    later = 20 * 3600
    assert times_used(feed, [0, 160, 161, later, later + 1]) == [0, 160, 161, later, later + 1]
    assert warnings == ["the time went on by more than an hour"]
    assert feed.stamp_of(0.0) == START + later * SECOND


@pytest.mark.fault_case(44)
@given(at=st.integers(-(10**9), 7 * 10**9).filter(lambda at: not -6 <= at <= 26), place=st.integers(1, 18))
def test_a_wrong_stamp_of_a_burst_costs_only_that_burst(at, place):
    feed, warnings = feed_of()
    starts = [at if k == place else k for k in range(20)]
    assert times_used(feed, starts) == [k for k in range(20) if k != place]
    assert warnings == []


@pytest.mark.fault_case(44)
@given(at=st.integers(-(10**9), 7 * 10**9).filter(lambda at: abs(at) > 4000))
def test_a_stamp_of_the_rig_that_is_hours_off_has_no_time(at):
    feed, _ = feed_of()
    times_used(feed, [0, 1])
    assert feed.seconds(START + at * SECOND) is None
    given_strokes = []
    feed.following.take_strokes = lambda pump, times: given_strokes.append((pump, times.tolist()))
    feed.take_strokes(START + 3 * SECOND, [(1, START + SECOND), (1, START + at * SECOND), (1, START + 2 * SECOND)])
    assert given_strokes == [(1, [1.0, 2.0])]


def test_a_wired_tool_gives_words_without_flow_and_its_survey_the_time_it_was_sent():
    tool = dataclasses.replace(starting("serial"), transmit_delay_s=0.0)
    data, sent = serial_channel.transmit(tool, 30.0, 3)
    feed, _ = feed_of(tool)
    words, surveys = [], []
    octets = np.frombuffer(data, dtype=np.uint8).astype(float)
    for k in range(0, len(octets), 10):
        out = feed.push(START + k * SECOND // 10, 1e-3, octets[k : k + 10])
        words += out.words
        surveys += out.surveys
    words += feed.finish().words
    assert [word.raw for word in words] == [word.raw for word in sent]
    assert len(surveys) == 1
    assert surveys[0].link == "serial"
    quality = feed.link.quality()
    assert (quality.state, quality.reason) == (3, "")
    assert math.isnan(quality.ebn0_db)
