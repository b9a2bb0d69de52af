# SPDX-License-Identifier: Apache-2.0
"""
WITS level 0 framing: lines of a four-digit code and a value, between `&&` and `!!`.

Frames are written strictly and read tolerantly: the reader accepts any line end, blanks, several frames in one read,
one frame in several reads, and junk between frames. Memory is bounded for any input, and after an error reading resumes
at the next `&&`. NaN is neither sent nor accepted.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable

from mwd_sensors.core import budgets
from mwd_sensors.core.foreign_text import unprintable

BEGIN, END, EOL = b"&&", b"!!", b"\r\n"
MAX_FRAME_BYTES = budgets.WITS.size
NULLS = (-9999.0, -8888.0, -999.25)  # numbers that mean "no value"
# Packet that a Pason-type recorder sends and expects every half minute: a vertical depth (item 0111) without a value.
KEEP_ALIVE = b"&&\r\n0111-9999\r\n!!\r\n"
_LINE = re.compile(rb"[ \t]*(\d\d)(\d\d)(.*)", re.DOTALL)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?")
_LONGEST_VALUE = 256  # largest number of bytes in a line


@dataclasses.dataclass(frozen=True)
class WitsItem:
    """One line: code RRII (record and item), text, number (None if the text is not a number), and null ("no value")."""

    code: int
    text: str
    number: float | None = None
    null: bool = False

    @property
    def record(self) -> int:
        """Record number, 1 to 99."""
        return self.code // 100


@dataclasses.dataclass(frozen=True)
class WitsFrame:
    """Items between `&&` and `!!`, in order."""

    items: tuple[WitsItem, ...]

    def number(self, code: int) -> float | None:
        """Return the number of the last item with this code; None if the item is missing, a text or a null."""
        for item in reversed(self.items):
            if item.code == code:
                return None if item.null else item.number
        return None


@dataclasses.dataclass
class DecoderCounts:
    """Numbers of frames, junk bytes between frames, frames cut off or too long, invalid lines, and null values."""

    frames: int = 0
    junk_bytes: int = 0
    broken_frames: int = 0
    bad_items: int = 0
    nulls: int = 0


def encode(items: Iterable[tuple[int, str]], source: str = "") -> bytes:
    """
    Return the bytes of one packet.

    items: code RRII and value text of each item. source: name of the sender, written first as item 1984; empty: item
    1984 is omitted.

    Raises
    ------
    ValueError
        The record or the item of a code is outside 1 to 99, or a text would break the frame.
    """
    lines = [BEGIN]
    for code, value in ([(1984, source)] if source else []) + list(items):
        if not (1 <= code // 100 <= 99 and 1 <= code % 100 <= 99):
            raise ValueError(f"code: {code:04d} is not an item of a record")
        lines.append(f"{code:04d}{checked_text(value)}".encode("ascii"))
    return EOL.join([*lines, END, b""])


def checked_text(text: str) -> str:
    """
    Return the text if it is allowed in a frame.

    Raises
    ------
    ValueError
        The text has a character outside printable ASCII, or `&&` or `!!`, which would break a frame.
    """
    if not all(" " <= c <= "~" for c in text) or "&&" in text or "!!" in text:
        raise ValueError(f"text: {text!r} must be printable ASCII without && and !!")
    return text


def plain_text(text: str) -> str:
    """Return a name as WITS allows it: `?` for non-ASCII letters, no `&&` or `!!`, at most 16 characters."""
    shown = "".join(c if " " <= c <= "~" else "?" for c in text)
    return shown.replace("&&", "&").replace("!!", "!").replace("&&", "&").replace("!!", "!").strip()[:16]


class Decoder:
    """Decoder of frames from bytes in pieces; at most `MAX_FRAME_BYTES` of an unfinished frame are kept."""

    def __init__(self) -> None:
        self.counts = DecoderCounts()
        self._buffer = bytearray()
        self._inside = False
        # Position up to which the buffer was searched for the next mark.
        self._searched = 0

    @property
    def waiting(self) -> int:
        """Number of bytes in the buffer, which belong to a frame that has not ended yet."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[WitsFrame]:
        """Return the frames that end within `data`."""
        frames: list[WitsFrame] = []
        # Work in pieces, so that the buffer stays bounded for any input size.
        for at in range(0, len(data), 16384):
            self._buffer += data[at : at + 16384]
            self._extract(frames)
        return frames

    def _extract(self, frames: list[WitsFrame]) -> None:
        while True:
            if not self._inside:
                start = self._buffer.find(BEGIN)
                if start < 0:
                    keep = 1 if self._buffer.endswith(b"&") else 0
                    self.counts.junk_bytes += _junk(self._buffer[: len(self._buffer) - keep])
                    del self._buffer[: len(self._buffer) - keep]
                    return
                self.counts.junk_bytes += _junk(self._buffer[:start])
                del self._buffer[: start + 2]
                self._inside, self._searched = True, 0
            begin = self._buffer.find(BEGIN, self._searched)
            end = self._buffer.find(END, self._searched, begin if begin >= 0 else len(self._buffer))
            if begin >= 0 and end < 0:
                # A new frame begins although the last one did not end.
                self.counts.broken_frames += 1
                del self._buffer[: begin + 2]
                self._searched = 0
                continue
            if end < 0:
                if len(self._buffer) <= MAX_FRAME_BYTES:
                    self._searched = max(0, len(self._buffer) - 1)
                    return
                self._give_up()
                continue
            if end > MAX_FRAME_BYTES:
                self._give_up()
                continue
            frames.append(self._frame(bytes(self._buffer[:end])))
            self.counts.frames += 1
            del self._buffer[: end + 2]
            self._inside, self._searched = False, 0

    def _give_up(self) -> None:
        """Drop a frame that is too long; keep a last `&`, which may begin the next `&&`."""
        self.counts.broken_frames += 1
        keep = 1 if self._buffer.endswith(b"&") else 0
        del self._buffer[: len(self._buffer) - keep]
        self._inside, self._searched = False, 0

    def _frame(self, body: bytes) -> WitsFrame:
        items = []
        for line in re.split(rb"[\r\n]+", body):
            if not line.strip(b" \t\0"):
                continue
            item = self._item(line)
            if item is None:
                self.counts.bad_items += 1
            else:
                items.append(item)
        return WitsFrame(tuple(items))

    def _item(self, line: bytes) -> WitsItem | None:
        match = _LINE.fullmatch(line)
        if match is None or len(line) > _LONGEST_VALUE or match[1] == b"00" or match[2] == b"00":
            return None
        text = match[3].decode("latin-1").strip(" \t")
        if unprintable(text):
            return None
        code = int(match[1]) * 100 + int(match[2])
        if not text:
            self.counts.nulls += 1
            return WitsItem(code, "", None, null=True)
        if text.lstrip("+-").lower() in ("nan", "inf", "infinity"):
            return None
        number = float(text) if _NUMBER.fullmatch(text) else None
        if number is not None and not math.isfinite(number):
            return None
        null = number in NULLS
        self.counts.nulls += null
        return WitsItem(code, text, number, null)


def _junk(between: bytes | bytearray) -> int:
    """Return how many of the bytes between two frames are neither line ends nor blanks."""
    return len(between) - sum(between.count(c) for c in (b"\r", b"\n", b" ", b"\t"))
