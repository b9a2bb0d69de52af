# SPDX-License-Identifier: Apache-2.0
"""Serial frames: inverse pairs, and no damage passes that the checks can see."""

import pytest
from hypothesis import given
from hypothesis.strategies import binary, integers

from mwd_sensors.telemetry import checksum, serial_frames
from mwd_sensors.telemetry.carrier import unpacked
from mwd_sensors.telemetry.sequences import parse
from mwd_sensors.telemetry.words import COMMON

ITEMS = parse("Inc:12:P Azm:12:P")
FRAME = serial_frames.encode(("survey", 1), 300, (1234, 4095), ITEMS)


def test_the_check_is_the_catalogue_s():
    """Check value of CRC-16/IBM-3740 for the digits 1 to 9."""
    assert checksum.crc16(b"123456789") == 0x29B1


@given(data=binary(min_size=1, max_size=600))
def test_cobs_comes_back_and_holds_no_zero(data):
    sent = serial_frames.cobs(data)
    assert 0 not in sent
    assert len(sent) <= len(data) + 1 + len(data) // 254
    assert serial_frames.uncobs(sent) == data


@pytest.mark.parametrize(
    ("plain", "sent"),
    [(b"\0", b"\1\1"), (b"\0\0", b"\1\1\1"), (b"\x11\x22\0\x33", b"\3\x11\x22\2\x33"), (b"\x11", b"\2\x11")],
)
def test_cobs_is_that_of_its_paper(plain, sent):
    assert serial_frames.cobs(plain) == sent


def test_a_frame_comes_back():
    frame = serial_frames.read(FRAME[:-1])
    assert (frame.kind, frame.number, frame.counter) == ("survey", 1, 300 % 256)
    assert unpacked(frame.words, [item.length for item in ITEMS]) == (1234, 4095)
    assert len(FRAME) == serial_frames.frame_bytes(ITEMS)


@given(place=integers(0, 8 * (len(FRAME) - 1) - 1), other=integers(0, 8 * (len(FRAME) - 1) - 1))
def test_one_or_two_wrong_bits_are_seen(place, other):
    wrong = bytearray(FRAME[:-1])
    wrong[place // 8] ^= 1 << place % 8
    if other != place:
        wrong[other // 8] ^= 1 << other % 8
    assert all(serial_frames.read(bytes(part)) is None for part in wrong.split(b"\0"))


def test_lines_of_text_come_back():
    values = [
        serial_frames.written(item, COMMON[item.name], code) for item, code in zip(ITEMS, (1000, 2000), strict=True)
    ]
    line = serial_frames.encode_line(values, check=True)
    assert line.endswith(b"\r\n")
    found = dict(serial_frames.read_line(line[:-2], check=True))
    assert COMMON["Inc"].code(float(found["Inc"])) == 1000
    assert COMMON["Azm"].code(float(found["Azm"])) == 2000
    assert serial_frames.read_line(line[:-2].replace(b"=4", b"=5"), check=True) is None
    assert serial_frames.read_line(b"Inc 12.3", check=False) is None
