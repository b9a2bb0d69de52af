# SPDX-License-Identifier: Apache-2.0
"""
Encode and decode frames of words on a serial line, binary (COBS, CRC-16) or as lines of text.

A binary frame is COBS of: kind, number and a fixed pattern (1 byte), counter (1), number of bytes of the words (1),
packed words, CRC-16. A zero byte ends it. A line of text is `Inc=12.34,Azm=201.5`, followed by `*` and the CRC-16 in
hex if `check` is set. Source: S. Cheshire, M. Baker, Consistent overhead byte stuffing, IEEE/ACM Trans. Networking 7
(1999) 159.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

from mwd_sensors.core.settings import setting
from mwd_sensors.telemetry.carrier import KINDS, packed
from mwd_sensors.telemetry.checksum import CRC_BYTES, START, crc16, holds, signed
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.words import Word

END = 0  # byte that ends a frame; COBS data contains no other zero byte
_PATTERN = 0b0101  # low half of the first byte
_HEADER_BYTES = 3
_LONGEST = 254  # largest number of bytes of one COBS block
BITS_PER_BYTE = 10  # start bit, 8 data bits, stop bit


@dataclasses.dataclass(frozen=True)
class SerialLine:
    """A serial line and the format of its frames."""

    format: str = setting("binary", "Format of the frames: binary with CRC-16, or text.", choices=("binary", "ascii"))
    check: bool = setting(
        True, "Whether lines of text end with a CRC-16. Without a CRC-16 wrong digits cannot be detected."
    )
    baud: int = setting(
        9600, "Speed of the line; 8 data bits, no parity, 1 stop bit.", unit="bit/s", low=50, high=4_000_000
    )
    period_s: float = setting(1.0, "Time from one frame to the next.", low=0.0, high=3600.0)


class SerialFrame(NamedTuple):
    """Content of a binary frame with a valid check: kind and number of the sequence, counter, packed words."""

    kind: str
    number: int
    counter: int
    words: bytes


def check(items: Sequence[SequenceItem]) -> None:
    """Raise ValueError if the words are longer than one COBS block: a frame would then not have a fixed length."""
    if _HEADER_BYTES + payload_bytes(items) + CRC_BYTES >= _LONGEST:
        raise ValueError(f"{payload_bytes(items)} bytes are too many for a serial frame; at most {_LONGEST - 6} fit")


def payload_bytes(items: Sequence[SequenceItem]) -> int:
    """Return the number of bytes of the words in a frame."""
    return math.ceil(sum(item.length for item in items) / 8)


def frame_bytes(items: Sequence[SequenceItem]) -> int:
    """Return the number of bytes of a binary frame on the line, including its end."""
    return _HEADER_BYTES + payload_bytes(items) + CRC_BYTES + 2


def cobs(data: bytes) -> bytes:
    """Return bytes encoded by consistent overhead byte stuffing, so that no byte is zero."""
    out = bytearray()
    for run in data.split(b"\0"):
        while len(run) >= _LONGEST:
            out += b"\xff" + run[:_LONGEST]
            run = run[_LONGEST:]
        out += bytes([len(run) + 1]) + run
    return bytes(out)


def uncobs(data: bytes) -> bytes | None:
    """Decode bytes made by `cobs`; return None if they are not valid COBS."""
    out, at = bytearray(), 0
    while at < len(data):
        code = data[at]
        run = data[at + 1 : at + code]
        if code == 0 or len(run) != code - 1 or 0 in run:
            return None
        out += run
        at += code
        if code <= _LONGEST and at < len(data):
            out.append(0)
    return bytes(out)


def encode(
    name: tuple[str, int], counter: int, codes: Sequence[int], items: Sequence[SequenceItem], start: int = START
) -> bytes:
    """
    Encode the words of a sequence, each sent once, as a binary frame with its end byte.

    Parameters
    ----------
    name : (str, int)
        "survey" or "toolface", and the number of the sequence, below 8.
    counter : int
        Number that rises by one with each frame; its low 8 bits are sent.
    codes : sequence of int
        Codes of the words, including parity bits.
    start : int
        Start value of the check.
    """
    first = KINDS.index(name[0]) << 7 | name[1] << 4 | _PATTERN
    size = payload_bytes(items)
    words = packed(codes, [item.length for item in items], 8 * size)
    return cobs(signed(bytes([first, counter & 0xFF, size]) + words, start)) + bytes([END])


def read(data: bytes, start: int = START) -> SerialFrame | None:
    """Decode the bytes between two end bytes; return None if COBS, check, pattern or length is not valid."""
    plain = uncobs(data)
    if plain is None or not holds(plain, start) or len(plain) < _HEADER_BYTES + CRC_BYTES + 1:
        return None
    first, counter, size = plain[:_HEADER_BYTES]
    words = plain[_HEADER_BYTES:-CRC_BYTES]
    if first & 15 != _PATTERN or size != len(words):
        return None
    return SerialFrame(KINDS[first >> 7], first >> 4 & 7, counter, words)


def written(item: SequenceItem, word: Word, code: int) -> str:
    """Return name and value of a code with as many digits as its step needs, for example `Inc=12.34`."""
    digits = max(0, math.ceil(-math.log10(word.step(item.bits))) + 1)
    return f"{item.name}={word.value(code, item.bits):.{digits}f}"


def encode_line(values: Sequence[str], check: bool) -> bytes:
    """Return a line of text; values are texts that `written` has returned."""
    line = ",".join(values).encode("ascii")
    return line + (b"*%04X" % crc16(line) if check else b"") + b"\r\n"


def read_line(line: bytes, check: bool) -> list[tuple[str, str]] | None:
    """Return names and values of a line of text without its end, or None if check or format is not valid."""
    if check:
        line, star, given = line.rpartition(b"*")
        if not star or given != b"%04X" % crc16(line):
            return None
    pairs = [part.partition("=") for part in line.decode("ascii", errors="replace").split(",")]
    if not all(name and equal and value for name, equal, value in pairs):
        return None
    return [(name, value) for name, _, value in pairs]
