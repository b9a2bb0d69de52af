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
# Kind of a frame -> topic of its samples and form of the content (`struct`).
_SAMPLES = {1: ("imu/data_raw", "<qddddddH"), 2: ("imu/mag", "<qdddH"), 3: ("gyro/data_raw", "<qddddddH")}
_SAMPLES |= {4: ("imu/temperature", "<qdH")}
_TIME, _INFO = 16, 17
# Kind of a frame -> its name in a line of text.
_NAMES = {1: "IMU", 2: "MAG", 3: "GYRO", 4: "TEMP", _TIME: "CLOCK", _INFO: "PROBE"}
_FORMS = {kind: form for kind, (_, form) in _SAMPLES.items()} | {_TIME: "<qq"}
#: Command to a probe -> kind of its frame. The commands start and stop the samples, and request time and name.
COMMANDS = {"start": 32, "stop": 33, "time": 34, "info": 35}
_BY_NAME = {name: kind for kind, name in _NAMES.items()}
_BY_TOPIC = {topic: kind for kind, (topic, _) in _SAMPLES.items()}
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
    return _encoded(_BY_TOPIC[reading.topic], counter, text, reading.stamp_ns, *reading.values, reading.status)


def _encoded(kind: int, counter: int, text: bool, *numbers: float) -> bytes:
    if text:
        return line(_NAMES[kind], counter, *numbers)
    return frame(kind, counter, struct.pack(_FORMS[kind], *numbers))


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
        return _encoded(_TIME, counter, text, given.sent_ns, given.unit_ns)
    if text:
        return line(_NAMES[_INFO], counter, given.text.replace(",", " "))
    return frame(_INFO, counter, given.text.encode("ascii", "replace"))


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

    def feed(self, data: bytes) -> list[tuple[int | str, bytes]]:
        """Accept bytes and return kind (number or name) and content of each complete frame or line."""
        *whole, self._held = (self._held + data).split(b"\n" if self.text else END)
        if len(self._held) > _LONGEST:
            self._held = b""
            self.counters.broken += 1
        found = []
        for one in whole:
            plain = _of_line(one) if self.text else _of_frame(one)
            if plain is None and self.text and (begin := one.rfind(b"$")) > 0:
                # Noise, or a line whose end was lost, stands before a line.
                plain = _of_line(one[begin:])
                self.counters.broken += plain is not None and self._begun
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
    """

    def __init__(self, text: bool) -> None:
        self._splitter = Splitter(text)
        self.counters = self._splitter.counters

    def feed(self, data: bytes) -> list[UnitSample | UnitAnswer]:
        """Accept bytes and return complete samples and answers in order; invalid frames are counted as broken."""
        found: list[UnitSample | UnitAnswer] = []
        for kind, content in self._splitter.feed(data):
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
        kind = _BY_NAME.get(kind, 0)
        if kind in _FORMS:
            # As in a binary frame; a number outside the range of the frame is an error.
            pairs = zip(_FORMS[kind][1:], words, strict=True)
            content = struct.pack(_FORMS[kind], *(float(word) if one == "d" else int(word) for one, word in pairs))
    if kind == _INFO:
        return UnitAnswer("info", content.decode("ascii", "replace"))
    if kind not in _FORMS:
        return None
    numbers = struct.unpack(_FORMS[kind], content)
    if kind == _TIME:
        return UnitAnswer("time", sent_ns=numbers[0], unit_ns=numbers[1])
    return UnitSample(_SAMPLES[kind][0], numbers[0], numbers[1:-1], numbers[-1])


def requested(kind: int | str, content: bytes) -> tuple[str, int] | None:
    """Return name and host time, ns, of a command that a probe has received; None for another frame or line."""
    names = {number: name for name, number in COMMANDS.items()}
    if isinstance(kind, str):
        return (kind.lower(), int(content)) if kind.lower() in COMMANDS and content.isdigit() else None
    if kind not in names or len(content) != 8:
        return None
    return names[kind], int(struct.unpack("<q", content)[0])
