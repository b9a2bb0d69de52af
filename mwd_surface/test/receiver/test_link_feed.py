# SPDX-License-Identifier: Apache-2.0
"""A link fed with bursts: stamps to times, pressure waits for its strokes, a clock that is set begins anew."""

import dataclasses

import numpy as np
import pytest

from mwd_sensors.simulator.serial_channel import transmit
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, starting
from mwd_surface.receiver.link_attitude import AgeRules
from mwd_surface.receiver.link_feed import LinkFeed

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
    feed, _ = feed_of()
    feed.push(START, 0.01, PRESSURE)
    feed.take_strokes(START + SECOND, [(1, START + SECOND // 2)])
    feed.push(START + SECOND, 0.01, PRESSURE)
    assert feed.link.now_s == pytest.approx(0.99)
    feed.take_strokes(START + 2 * SECOND, [])
    assert feed.link.now_s == pytest.approx(1.99)
    for k in range(2, 16):
        feed.push(START + k * SECOND, 0.01, PRESSURE)
    assert 3.0 < feed.link.now_s < 7.0
    feed.finish()
    assert feed.link.now_s == pytest.approx(15.99)


def test_a_clock_that_goes_back_begins_anew_with_a_word():
    feed, warnings = feed_of()
    feed.push(START, 0.01, PRESSURE)
    feed.push(START + 60 * SECOND, 0.01, PRESSURE)
    feed.push(START - 60 * SECOND, 0.01, PRESSURE)
    assert len(warnings) == 1
    assert "back" in warnings[0]
    assert feed.stamp_of(0.0) == START - 60 * SECOND


@pytest.mark.fault_case(43)
def test_a_gap_of_hours_begins_anew_instead_of_being_filled():
    feed, warnings = feed_of()
    feed.push(START, 0.01, PRESSURE)
    feed.push(START + 160 * SECOND, 0.01, PRESSURE)
    assert warnings == []
    feed.push(START + 20 * 3600 * SECOND, 0.01, PRESSURE)
    assert warnings == ["the time went on by more than an hour"]
    assert feed.link.now_s == pytest.approx(0.99)


def test_a_wired_tool_gives_words_without_flow_and_its_survey_the_time_it_was_sent():
    tool = dataclasses.replace(starting("serial"), transmit_delay_s=0.0)
    data, sent = transmit(tool, 30.0, 3)
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
    assert (quality.state, quality.reason, quality.has_signal) == (3, "", False)
