# SPDX-License-Identifier: Apache-2.0
"""What goes on air: the same words as pulses, blocks of a carrier and frames of a line."""

import dataclasses

import numpy as np
import pytest

from mwd_sensors.telemetry import carrier, on_air, serial_frames
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration, encode

TOOL = ToolConfiguration(survey_sequences=("Inc:12:P Azm:12:P DipA:12:P Grav:12:P",), toolface_sequences=("aTFA:6",))
CODES = (1, 2, 3, 4)


def signals(tool, counter=7):
    found = []
    at = 0
    for group in on_air.groups(tool, "survey", 0):
        codes = CODES[at : at + len(group.items)]
        at += len(codes)
        found.append((group, on_air.signal(tool, group, tool.sent(group.items, codes), counter)))
    return found


def test_pulses_of_the_words_are_those_of_the_whole_sequence():
    edges, at = [], 0.0
    for _, one in signals(TOOL):
        edges += [at + edge for edge in one.edges_s]
        at += one.period_s
    whole = encode(TOOL, TOOL.surveys[0], CODES)
    assert edges == pytest.approx([edge * TOOL.tu_s for edge in whole.edges])
    assert at == pytest.approx(whole.length * TOOL.tu_s)


def test_blocks_of_a_carrier_hold_whole_words_and_follow_without_a_gap():
    tool = dataclasses.replace(TOOL, code="psk")
    found = signals(tool)
    assert [len(group.items) for group, _ in found] == [3, 1]
    assert all(one.period_s == one.duration_s == tool.carrier.block_s for _, one in found)
    assert all(len(one.phases) == tool.carrier.block_symbols for _, one in found)
    marker = np.exp(1j * np.array(found[0][1].phases))[tool.carrier.half : tool.carrier.half + carrier.MARKER_SYMBOLS]
    assert marker == pytest.approx(carrier.marker())


def test_a_frame_of_a_line_holds_the_sequence_and_begins_a_period_after_the_last():
    tool = dataclasses.replace(TOOL, code="serial")
    ((group, one),) = signals(tool)
    frame = serial_frames.read(one.octets[:-1], tool.table_check)
    lengths = [item.length for item in group.items]
    assert (frame.kind, frame.number, frame.counter) == ("survey", 0, 7)
    assert carrier.unpacked(frame.words, lengths) == tool.sent(group.items, CODES)
    assert one.period_s == tool.serial.period_s > one.duration_s


def test_a_number_beyond_the_last_sequence_is_the_last():
    assert on_air.groups(TOOL, "toolface", 3)[0].items == TOOL.toolfaces[0]
