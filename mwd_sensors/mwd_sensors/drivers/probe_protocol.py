# SPDX-License-Identifier: Apache-2.0
"""
Serial protocol of the probe: samples, time, commands and answers, as binary frames or as lines of text.

A binary frame is COBS of: kind (1 byte), counter (1), content, CRC-16; a zero byte ends it. Numbers are little endian:
stamps int64, ns; values float64, SI; status uint16. A line of text is `$KIND,counter,...*CRC`. Its CRC-16, in hex,
covers the text between `$` and `*`; each value has enough digits to read back the same number. Both forms carry every
sample without loss.

Source of COBS: S. Cheshire, M. Baker, Consistent overhead byte stuffing, IEEE/ACM Trans. Networking 7 (1999) 159.
"""

from __future__ import annotations

import struct

from mwd_sensors.drivers.readings import FrameCounters, UnitAnswer, UnitSample
from mwd_sensors.telemetry.checksum import CRC_BYTES, crc16, holds, signed
from mwd_sensors.telemetry.serial_frames import cobs, uncobs

END = b"\0"
# Kind of a frame -> its name in a line of text, its topic, and the number of values in a sample.
_SAMPLES = {1: ("IMU", "imu/data_raw", 6), 2: ("MAG", "imu/mag", 3), 3: ("GYRO", "gyro/data_raw", 6)}
_SAMPLES |= {4: ("TEMP", "imu/temperature", 1)}
_TIME, _INFO = 16, 17
COMMANDS = {"start": 32, "stop": 33, "time": 34, "info": 35}
"""Command to a probe -> kind of its frame. The commands start and stop the samples, and request time and name."""
_BY_NAME = {name: (topic, count) for name, topic, count in _SAMPLES.values()}
_BY_TOPIC = {topic: (kind, name) for kind, (name, topic, _) in _SAMPLES.items()}
# Largest number of bytes without an end; more bytes are not a frame and are dropped.
_LONGEST = 512


def frame(kind: int, counter: int, content: bytes) -> bytes:
    """Return a binary frame including its end byte."""
    return cobs(signed(bytes([kind, counter & 0xFF]) + content)) + END


def line(name: str, counter: int, *words: object) -> bytes:
    """Return a line of text including its end; floats are written so that they read back exactly."""
    text = ",".join([name, str(counter & 0xFF), *(repr(w) if isinstance(w, float) else str(w) for w in words)])
    return b"$%s*%04X\r\n" % (text.encode("ascii"), crc16(text.encode("ascii")))


def sample(reading: UnitSample, counter: int, text: bool) -> bytes:
    """Encode a sample as a binary frame or, if text is true, as a line of text."""
    kind, name = _BY_TOPIC[reading.topic]
    if text:
        return line(name, counter, reading.stamp_ns, *reading.values, reading.status)
    packed = struct.pack(f"<q{len(reading.values)}dH", reading.stamp_ns, *reading.values, reading.status)
    return frame(kind, counter, packed)


def command(name: str, counter: int, text: bool, now_ns: int = 0) -> bytes:
    """
    Encode a command of `COMMANDS` as a binary frame or, if text is true, as a line of text.

    now_ns is the host's time, which the command `time` carries.
    """
    if text:
        return line(name.upper(), counter, now_ns)
    return frame(COMMANDS[name], counter, struct.pack("<q", now_ns))


def answer(given: UnitAnswer, counter: int, text: bool) -> bytes:
    """Encode an answer of a probe as a binary frame or, if text is true, as a line of text."""
    if given.kind == "time":
        content = struct.pack("<qq", given.sent_ns, given.unit_ns)
        return line("CLOCK", counter, given.sent_ns, given.unit_ns) if text else frame(_TIME, counter, content)
    words = given.text.replace(",", " ")
    return line("PROBE", counter, words) if text else frame(_INFO, counter, given.text.encode("ascii", "replace"))


class Splitter:
    """
    Splitter of the bytes of a line, in blocks of any size, into frames or text lines with a valid check.

    text selects lines of text instead of binary frames.
    """

    def __init__(self, text: bool) -> None:
        self.text = text
        self.counters = FrameCounters()
        self._held = b""
        self._counter = -1
        # Bytes before the first end may be the rest of a frame and are not counted as broken.
        self._begun = False

    def take(self, data: bytes) -> list[tuple[int | str, bytes]]:
        """Accept bytes and return kind (number or name) and content of each complete frame or line."""
        *whole, self._held = (self._held + data).split(b"\n" if self.text else END)
        if len(self._held) > _LONGEST:
            self._held = b""
            self.counters.broken += 1
        found = []
        for one in whole:
            plain = _of_line(one) if self.text else _of_frame(one)
            if plain is not None:
                self._count(plain[1])
                found.append((plain[0], plain[2]))
            elif one.strip(b"\r") and self._begun:
                self.counters.broken += 1
            self._begun = True
        return found

    def _count(self, counter: int) -> None:
        self.counters.frames += 1
        if self._counter >= 0:
            self.counters.lost += (counter - self._counter - 1) % 256
        self._counter = counter


def _of_frame(data: bytes) -> tuple[int, int, bytes] | None:
    plain = uncobs(data)
    if plain is None or len(plain) < 2 + CRC_BYTES or not holds(plain):
        return None
    return plain[0], plain[1], plain[2:-CRC_BYTES]


def _of_line(data: bytes) -> tuple[str, int, bytes] | None:
    text, star, check = data.rstrip(b"\r").rpartition(b"*")
    if not star or not text.startswith(b"$") or check != b"%04X" % crc16(text[1:]):
        return None
    name, _, rest = text[1:].partition(b",")
    counter, _, content = rest.partition(b",")
    return (name.decode("ascii", "replace"), int(counter) & 0xFF, content) if counter.isdigit() else None


class ProbeReader:
    """
    Decoder of the bytes of a probe: samples and answers.

    text selects lines of text instead of binary frames.

    Attributes
    ----------
    counters : FrameCounters
    """

    def __init__(self, text: bool) -> None:
        self._splitter = Splitter(text)
        self.counters = self._splitter.counters

    def take(self, data: bytes) -> list[UnitSample | UnitAnswer]:
        """Accept bytes and return complete samples and answers in order; invalid frames are counted as broken."""
        found: list[UnitSample | UnitAnswer] = []
        for kind, content in self._splitter.take(data):
            try:
                one = _parsed(kind, content)
            except (ValueError, struct.error):
                self.counters.broken += 1
                continue
            if one is not None:
                found.append(one)
        return found


def _parsed(kind: int | str, content: bytes) -> UnitSample | UnitAnswer | None:
    """
    Return the sample or answer in a frame or line, or None if its kind is not known (a later version).

    Raises ValueError or struct.error if the content does not fit the kind.
    """
    if isinstance(kind, str):
        words = content.decode("ascii").split(",")
        if kind in _BY_NAME:
            topic, count = _BY_NAME[kind]
            if len(words) != count + 2:
                raise ValueError(f"{kind}: {len(words)} values")
            stamp_ns, status = _whole(words[0]), _whole(words[-1], 0, 1 << 16)
            return UnitSample(topic, stamp_ns, tuple(float(word) for word in words[1:-1]), status)
        if kind == "CLOCK":
            sent_ns, unit_ns = map(_whole, words)
            return UnitAnswer("time", sent_ns=sent_ns, unit_ns=unit_ns)
        return UnitAnswer("info", content.decode("ascii")) if kind == "PROBE" else None
    if kind in _SAMPLES:
        _, topic, count = _SAMPLES[kind]
        stamp_ns, *values, status = struct.unpack(f"<q{count}dH", content)
        return UnitSample(topic, stamp_ns, tuple(values), status)
    if kind == _TIME:
        sent_ns, unit_ns = struct.unpack("<qq", content)
        return UnitAnswer("time", sent_ns=sent_ns, unit_ns=unit_ns)
    return UnitAnswer("info", content.decode("ascii", "replace")) if kind == _INFO else None


def _whole(word: str, low: int = -(1 << 63), end: int = 1 << 63) -> int:
    """Return the integer in a text; raise ValueError unless low <= integer < end, the range in a binary frame."""
    number = int(word)
    if not low <= number < end:
        raise ValueError(f"{word}: not within {low} and {end - 1}")
    return number


def requested(kind: int | str, content: bytes) -> tuple[str, int] | None:
    """Return name and host time, ns, of a command that a probe has received; None for another frame or line."""
    names = {number: name for name, number in COMMANDS.items()}
    if isinstance(kind, str):
        return (kind.lower(), int(content)) if kind.lower() in COMMANDS and content.isdigit() else None
    if kind not in names or len(content) != 8:
        return None
    return names[kind], int(struct.unpack("<q", content)[0])
