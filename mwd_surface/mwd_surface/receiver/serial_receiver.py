# SPDX-License-Identifier: Apache-2.0
"""
Receiver of a wired tool: bytes of a serial line in, words out. The result does not depend on how the bytes are cut.

A CRC-16 lets one in 65 536 damaged frames pass. A frame must also be COBS of the right length, carry the pattern,
number and length of a sequence of this tool, have zeros as filling of its last byte and even parities, and have a
counter that follows the last one. A text line without a check must hold values that the tool can send, digit by digit;
the probability that wrong values pass by chance is estimated from the share of lines that fail.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry import serial_frames
from mwd_sensors.telemetry.carrier import KINDS, packed, unpacked
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.belief import Judged
from mwd_surface.receiver.words import FrameReport, Reception, WordPlace, no_words, received

_LONGEST = 600  # longest frame, bytes; more bytes without an end are noise or another baud rate
_FOLLOWS = 16  # largest step of the counter between two frames, if frames are lost
_REMEMBERED = 200  # number of the last frames or lines whose checks give the confidence
_CRC_BY_CHANCE = 2.0**-16  # probability that the CRC of a damaged frame holds
# Probability that a damaged line without check still holds valid values, for a few wrong digits.
_VALUE_BY_CHANCE = 0.1


class _Heard(NamedTuple):
    """Content of a frame or line: kind and items of its sequence, codes, time, and counter if it has one."""

    kind: str
    items: tuple[SequenceItem, ...]
    codes: tuple[int, ...]
    span: tuple[float, float]
    counter: int | None


class SerialReceiver:
    """Receiver of a tool on a serial line."""

    def __init__(self, tool: ToolConfiguration) -> None:
        self._tool = tool
        self._ascii = tool.serial.format == "ascii"
        self._end = b"\n"[0] if self._ascii else serial_frames.END
        self._open = bytearray()
        self._begin = self._last = 0.0
        self._counter: int | None = None
        self._held: _Heard | None = None
        self._frame = 0
        self._outcomes: deque[bool] = deque(maxlen=_REMEMBERED)
        self._bytes = 0
        self.last_sync_s = -math.inf

    def push(self, time_s: Array, data: Array) -> Reception:
        """
        Add bytes and return the words they complete.

        Parameters
        ----------
        time_s : ndarray, shape (n,)
            Time of arrival of each byte.
        data : ndarray, shape (n,)
            Whole numbers from 0 to 255.
        """
        done = Reception()
        raw = np.asarray(data).astype(np.uint8).tobytes()
        self._bytes += len(raw)
        start = 0
        while start < len(raw):
            stop = raw.find(self._end, start)
            piece = raw[start:] if stop < 0 else raw[start:stop]
            if not self._open and piece:
                self._begin = float(time_s[start])
            self._open += piece
            if stop < 0:
                del self._open[: max(len(self._open) - _LONGEST, 0)]
                return done
            self._last = float(time_s[stop])
            self._read_frame(bytes(self._open), done)
            self._open.clear()
            start = stop + 1
        return done

    def finish(self) -> Reception:
        """Return the words of a frame that still waits for confirmation by the next frame."""
        done = Reception()
        if self._held is not None:
            self._emit(self._held, done)
            self._held = None
        return done

    def why_nothing(self) -> str:
        """Return the reason, in one sentence, why there is no word."""
        if not self._bytes:
            return no_words("no bytes came; check the cable, the port and that the probe has power")
        if not self._outcomes:
            return no_words(f"{self._bytes} bytes without the end of a frame; check baud and format in the tool file")
        return no_words(
            f"{len(self._outcomes)} frames, but none passes its check; compare baud, format, sequences and"
            " words with the tool file"
        )

    def _read_frame(self, data: bytes, done: Reception) -> None:
        if not data.strip(b"\r"):
            return
        heard = self._line(data.rstrip(b"\r")) if self._ascii else self._binary(data)
        self._outcomes.append(heard is not None)
        if heard is None:
            return
        self.last_sync_s = heard.span[0]
        if heard.counter is None or _follows(heard.counter, self._counter):
            self._held = None
            self._accept(heard, done)
        elif self._held is not None and _follows(heard.counter, self._held.counter):
            # Neither frame follows the old counter, but they follow each other: the tool was restarted.
            self._accept(self._held, done)
            self._held = None
            self._accept(heard, done)
        else:
            self._held = heard

    def _accept(self, heard: _Heard, done: Reception) -> None:
        self._counter = heard.counter
        self._emit(heard, done)

    def _binary(self, data: bytes) -> _Heard | None:
        frame = serial_frames.read(data, self._tool.table_check)
        if frame is None:
            return None
        sequences = self._tool.surveys if frame.kind == KINDS[0] else self._tool.toolfaces
        if frame.number >= len(sequences):
            return None
        items = sequences[frame.number]
        lengths = [item.length for item in items]
        if len(frame.words) != serial_frames.payload_bytes(items):
            return None
        sent = unpacked(frame.words, lengths)
        if packed(sent, lengths, 8 * len(frame.words)) != frame.words:
            return None
        pairs = list(zip(sent, items, strict=True))
        if any(item.parity and self._tool.parity_bit(code >> 1) != code & 1 for code, item in pairs):
            return None
        codes = tuple(code >> 1 if item.parity else code for code, item in pairs)
        return _Heard(frame.kind, items, codes, (self._begin, self._last), frame.counter)

    def _line(self, line: bytes) -> _Heard | None:
        pairs = serial_frames.read_line(line, self._tool.serial.check)
        if pairs is None:
            return None
        for kind, sequences in zip(KINDS, (self._tool.surveys, self._tool.toolfaces), strict=True):
            for items in sequences:
                if [item.name for item in items] == [name for name, _ in pairs]:
                    codes = self._codes(items, [value for _, value in pairs])
                    return None if codes is None else _Heard(kind, items, codes, (self._begin, self._last), None)
        return None

    def _codes(self, items: Sequence[SequenceItem], values: Sequence[str]) -> tuple[int, ...] | None:
        """Return the codes of values as written by the tool; None if the tool never writes such a value."""
        codes = []
        for item, value in zip(items, values, strict=True):
            word = self._tool.table[item.name]
            try:
                code = word.missing(item.bits) if value == "nan" else word.code(float(value), item.bits)
            except ValueError:
                return None
            if code is None or code < 0 or serial_frames.written(item, word, code) != f"{item.name}={value}":
                return None
            codes.append(code)
        return tuple(codes)

    @property
    def _confidence(self) -> float:
        """Probability that a frame that passed the checks is right, from the share of recent frames that failed."""
        failed = (sum(not good for good in self._outcomes) + 1.0) / (len(self._outcomes) + 2.0)
        chance = _VALUE_BY_CHANCE if self._ascii and not self._tool.serial.check else _CRC_BY_CHANCE
        return max(1.0 - chance * failed / (1.0 - failed), 0.0)

    def _emit(self, heard: _Heard, done: Reception) -> None:
        confidence = self._confidence
        for k, (item, code) in enumerate(zip(heard.items, heard.codes, strict=True)):
            place = WordPlace(self._frame, k, heard.kind, 1)
            done.words.append(received(self._tool, item, Judged(code, confidence, ()), heard.span, place))
        done.frames.append(FrameReport(self._frame, heard.kind, *heard.span, math.nan, 0.0, ""))
        self._frame += 1


def _follows(counter: int | None, last: int | None) -> bool:
    return counter is not None and last is not None and 1 <= (counter - last) % 256 <= _FOLLOWS
