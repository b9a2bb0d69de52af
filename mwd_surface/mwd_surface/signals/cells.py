# SPDX-License-Identifier: Apache-2.0
"""Text of numbers, times and words in the cells of tables, the same in every file and report."""

from __future__ import annotations

import csv
import datetime as dt
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any


class Printed(str):
    """Printed number with its value before rounding, so that a report can print the value again in another unit."""

    number: float  #: value before rounding, in the unit of the text
    decimals: int

    def __new__(cls, text: str, number: float, decimals: int) -> Printed:
        """Return the text with its value before rounding, `number`, in the unit of the text."""
        printed = super().__new__(cls, text)
        printed.number, printed.decimals = number, decimals
        return printed

    def __getnewargs__(self) -> tuple[str, float, int]:  # type: ignore[override]
        """Return the arguments of `__new__` for a copy or for pickle."""
        return str(self), self.number, self.decimals


class Typed(str):
    """Text that people have typed: a name, a comment, a reason. It is neither translated nor converted."""


def typed(text: str) -> Typed:
    """Return a text that people have typed, on one line."""
    return Typed(plain(text))


def fixed(value: float | None, decimals: int, wrap: float = 0.0) -> str:
    """
    Return a number with the given number of decimals (`Printed`); empty for None or if not finite.

    The result is never "-0.00". A number that rounds to `wrap` (360.00 for an azimuth) is printed as zero.
    """
    if value is None or not math.isfinite(value):
        return ""
    text = f"{value:.{decimals}f}"
    if wrap and float(text) >= wrap:
        text = f"{0.0:.{decimals}f}"
    text = text[1:] if text.startswith("-") and float(text) == 0.0 else text
    return Printed(text, float(value), decimals)


def utc(stamp_ns: int) -> str:
    """Return a stamp, ns, as UTC text to the millisecond, "2026-05-14T13:57:00.123Z"; empty for 0 or less."""
    if stamp_ns <= 0:
        return ""
    seconds, rest = divmod(stamp_ns, 10**9)
    moment = dt.datetime.fromtimestamp(seconds, tz=dt.UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{rest // 10**6:03d}Z"


def plain(text: str) -> str:
    """Return text on one line without control characters, for a cell, a header or an attribute."""
    if not text.isprintable():
        text = "".join(c if c.isprintable() else " " for c in text)
    return " ".join(text.split())


def quoted(text: str) -> str:
    """Return a quoted cell of one line; an apostrophe precedes a text that a spreadsheet would read as a formula."""
    line = plain(text)
    if line[:1] in ("=", "+", "-", "@"):
        line = "'" + line
    return '"' + line.replace('"', '""') + '"'


def table(columns: Sequence[str], lines: Iterable[Mapping[str, Any]]) -> str:
    """Return a CSV table with its header; missing keys of a line become empty cells."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue()
