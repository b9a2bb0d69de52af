# SPDX-License-Identifier: Apache-2.0
"""The receiver of a serial line: what is damaged is left out, any cut gives the same, reasons are said."""

import dataclasses

import numpy as np
import pytest

from mwd_sensors.simulator.serial_channel import SerialChannel, SerialStream, transmit
from mwd_sensors.telemetry import serial_frames
from mwd_sensors.telemetry.tool_configuration import starting
from mwd_surface.receiver.serial_receiver import SerialReceiver

TOOL = dataclasses.replace(starting("serial"), transmit_delay_s=0.0)
LINES = dataclasses.replace(TOOL, serial=dataclasses.replace(TOOL.serial, format="ascii"))
RAW = dataclasses.replace(TOOL, serial=dataclasses.replace(TOOL.serial, format="ascii", check=False))


def received(tool, data, receiver=None):
    receiver = receiver or SerialReceiver(tool)
    raw = np.frombuffer(data, dtype=np.uint8).astype(float)
    done = receiver.push(np.arange(len(raw)) * 1e-3, raw)
    done.add(receiver.finish())
    return done


def frames_of(words):
    """Names and codes of each frame."""
    frames = {}
    for word in words:
        frames.setdefault(word.frame, []).append((word.name, word.raw))
    return [tuple(frame) for frame in frames.values()]


@pytest.mark.parametrize("tool", [TOOL, LINES, RAW], ids=["binary", "lines", "raw lines"])
def test_a_clean_line_is_read_whole(tool):
    data, sent = transmit(tool, 60.0, 3)
    got = received(tool, data)
    assert frames_of(got.words) == frames_of(sent)
    assert [frame.kind for frame in got.frames[:2]] == ["survey", "toolface"]
    # Without a check it takes lines that hold before one is believed.
    late = [word for word in got.words if word.frame > 30]
    assert all(word.status == "believed" for word in late)
    assert (got.words[0].status == "believed") == (tool is not RAW)


@pytest.mark.slow
@pytest.mark.parametrize(("tool", "bit_errors"), [(TOOL, 2.5e-3), (LINES, 8e-4)], ids=["binary", "lines"])
def test_no_wrong_value_passes_at_many_times_the_error_rate(tool, bit_errors):
    """
    Half of the frames damaged; at a bit error rate of 1e-4 one in thirty is.

    A CRC-16 alone would let 1.5e-5 of those pass: none of these thousands, and 5 of 1e7 frames. What else has to hold
    makes it less than one in 1e9 (docs/methods/carrier_and_serial.md).
    """
    data, sent = transmit(tool, 4000.0, 5)
    noisy = SerialStream(SerialChannel(bit_errors=bit_errors), 9600, 1).carry(0.0, data)
    got, true = frames_of(received(tool, noisy).words), set(frames_of(sent))
    assert set(got) <= true
    assert 0.1 * len(true) < len(got) < 0.9 * len(true)


@pytest.mark.slow
def test_lost_bytes_and_breaks_cost_their_frames_only():
    data, sent = transmit(TOOL, 2000.0, 5)
    channel = SerialChannel(lost_bytes=1e-3, breaks_per_hour=60.0, break_s=0.5)
    got = frames_of(received(TOOL, SerialStream(channel, 9600, 1).carry(0.0, data)).words)
    true = frames_of(sent)
    assert set(got) <= set(true)
    assert len(got) > 0.9 * len(true)


def test_any_cut_gives_the_same_words():
    data, _ = transmit(TOOL, 100.0, 3)
    data = SerialStream(SerialChannel(bit_errors=1e-3), 9600, 1).carry(0.0, data)
    whole = received(TOOL, data)
    receiver, words = SerialReceiver(TOOL), []
    raw, time = np.frombuffer(data, dtype=np.uint8).astype(float), np.arange(len(data)) * 1e-3
    for k in range(0, len(raw), 7):
        words += receiver.push(time[k : k + 7], raw[k : k + 7]).words
    assert words + receiver.finish().words == whole.words


def test_a_frame_that_does_not_follow_waits_for_the_next():
    data, sent = transmit(TOOL, 10.0, 3)
    frames = data.split(b"\0")[:-1]
    alone = serial_frames.encode(("toolface", 0), 200, (0,) * 17, TOOL.toolfaces[0], TOOL.table_check)
    mixed = b"\0".join([*frames[:4], alone[:-1], *frames[4:], b""])
    assert frames_of(received(TOOL, mixed).words) == frames_of(sent)


def test_another_table_of_words_is_not_believed():
    data, _ = transmit(TOOL, 60.0, 3)
    receiver = SerialReceiver(
        dataclasses.replace(TOOL, words={"Inc": dataclasses.replace(TOOL.table["Inc"], high=90.0)})
    )
    assert not received(None, data, receiver).words
    assert "none passes its check" in receiver.why_nothing()
    silent = SerialReceiver(TOOL)
    assert "no bytes" in silent.why_nothing()
    received(TOOL, b"\x55" * 300, silent)
    assert "baud" in silent.why_nothing()
