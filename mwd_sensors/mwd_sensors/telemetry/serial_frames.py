# SPDX-License-Identifier: Apache-2.0
"""
Frames of words on a serial line: binary (COBS, CRC-16) or lines of text.

A binary frame is COBS of: kind, number and a fixed pattern (1 byte), counter (1), length of the words (1), words
packed, CRC-16; a zero byte ends it. A line of text is `Inc=12.34,Azm=201.5`, with `*` and the CRC-16 in hex behind it
where `check` is set. Source: S. Cheshire, M. Baker, Consistent overhead byte stuffing, IEEE/ACM Trans. Networking 7
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

END = 0  # byte that ends a frame; COBS leaves no other
_PATTERN = 0b0101  # low half of the first byte
_HEADER_BYTES = 3
_LONGEST = 254
BITS_PER_BYTE = 10  # start, 8 data, stop


@dataclasses.dataclass(frozen=True)
class SerialLine:
    """A serial line and its frames."""

    format: str = setting("binary", "Frames: binary with CRC-16, or lines of text.", choices=("binary", "ascii"))
    check: bool = setting(
        True, "Lines of text carry a CRC-16. Without it a wrong digit cannot be seen, only guessed from broken lines."
    )
    baud: int = setting(9600, "Speed; 8 data bits, no parity, 1 stop bit.", unit="bit/s", low=50, high=4_000_000)
    period_s: float = setting(1.0, "From one frame to the next.", unit="s", low=0.0, high=3600.0)


class Frame(NamedTuple):
    """Content of a binary frame whose check holds: sequence, counter, words packed."""

    kind: str
    number: int
    counter: int
    words: bytes


def check(items: Sequence[SequenceItem]) -> None:
    """
    Refuse what no frame holds.

    Raises
    ------
    ValueError
        The words of a sequence are longer than one COBS block, so that a frame has no fixed length.
    """
    if _HEADER_BYTES + payload_bytes(items) + CRC_BYTES >= _LONGEST:
        raise ValueError(f"{payload_bytes(items)} bytes are too many for a serial frame; {_LONGEST - 6} are the most")


def payload_bytes(items: Sequence[SequenceItem]) -> int:
    """Bytes of the words of a frame."""
    return math.ceil(sum(item.length for item in items) / 8)


def frame_bytes(items: Sequence[SequenceItem]) -> int:
    """Bytes of a binary frame on the line, its end included."""
    return _HEADER_BYTES + payload_bytes(items) + CRC_BYTES + 2


def cobs(data: bytes) -> bytes:
    """Bytes without a zero."""
    out = bytearray()
    for run in data.split(b"\0"):
        while len(run) >= _LONGEST:
            out += b"\xff" + run[:_LONGEST]
            run = run[_LONGEST:]
        out += bytes([len(run) + 1]) + run
    return bytes(out)


def uncobs(data: bytes) -> bytes | None:
    """Bytes that `cobs` was given; None where these are no COBS bytes."""
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
    Binary frame of one pass of a sequence, its end included.

    Parameters
    ----------
    name : (str, int)
        "survey" or "toolface", and number of the sequence, below 8.
    counter : int
        Rises by one with each frame; its low 8 bits are sent.
    codes : sequence of int
        Of the words, parity bit included where they have one.
    items : sequence of SequenceItem
    start : int
        Of the check.
    """
    first = KINDS.index(name[0]) << 7 | name[1] << 4 | _PATTERN
    size = payload_bytes(items)
    words = packed(codes, [item.length for item in items], 8 * size)
    return cobs(signed(bytes([first, counter & 0xFF, size]) + words, start)) + bytes([END])


def read(data: bytes, start: int = START) -> Frame | None:
    """Content of the bytes between two ends; None where COBS, check, pattern or length do not fit."""
    plain = uncobs(data)
    if plain is None or not holds(plain, start) or len(plain) < _HEADER_BYTES + CRC_BYTES + 1:
        return None
    first, counter, size = plain[:_HEADER_BYTES]
    words = plain[_HEADER_BYTES:-CRC_BYTES]
    if first & 15 != _PATTERN or size != len(words):
        return None
    return Frame(KINDS[first >> 7], first >> 4 & 7, counter, words)


def written(item: SequenceItem, word: Word, code: int) -> str:
    """Value of a code with the digits that its step needs: `Inc=12.34`."""
    digits = max(0, math.ceil(-math.log10(word.step(item.bits))) + 1)
    return f"{item.name}={word.value(code, item.bits):.{digits}f}"


def encode_line(values: Sequence[str], check: bool) -> bytes:
    """Line of text of values as `written` gives them."""
    line = ",".join(values).encode("ascii")
    return line + (b"*%04X" % crc16(line) if check else b"") + b"\r\n"


def read_line(line: bytes, check: bool) -> list[tuple[str, str]] | None:
    """Names and values of a line of text without its end; None where the check or the form does not fit."""
    if check:
        line, star, given = line.rpartition(b"*")
        if not star or given != b"%04X" % crc16(line):
            return None
    pairs = [part.partition("=") for part in line.decode("ascii", errors="replace").split(",")]
    if not all(name and equal and value for name, equal, value in pairs):
        return None
    return [(name, value) for name, _, value in pairs]
