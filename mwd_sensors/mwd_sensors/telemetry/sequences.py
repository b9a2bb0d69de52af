# SPDX-License-Identifier: Apache-2.0
"""
Parse and write sequences, the lists of words that a tool sends, in the grammar that MWD kits use.

`Inc:12:P Azm:12:P 3{2{aTFA:6:P} Gama:8:P}`: name, number of bits, and P for a parity bit (N or nothing: none). A number
before braces repeats their content. Spaces, commas or semicolons separate words. Names may be written in any case if
only one word fits. A word without a number of bits has the number of the table of words.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from mwd_sensors.core.settings import unknown_key
from mwd_sensors.telemetry.words import COMMON, MAX_BITS, Word

# Largest number of words of a sequence with its repeats written out; more words are treated as a typing error in a
# repeat count.
MAX_WORDS = 1000
_TOKEN = re.compile(
    r"[\s,;]*(?:(\d*)\s*\{|(\})|([A-Za-z][A-Za-z0-9_]*)(?:\s*:\s*(\d+))?(?:\s*:\s*([PpNn]))?(?=[\s},;]|$))"
)


class SequenceItem(NamedTuple):
    """One word of a sequence: name, bits of the value, and whether a parity bit follows."""

    name: str
    bits: int
    parity: bool

    @property
    def length(self) -> int:
        """Number of transmitted bits, parity bit included."""
        return self.bits + self.parity


def parse(text: str, words: Mapping[str, Word] = COMMON) -> tuple[SequenceItem, ...]:
    """
    Return the words of a sequence in order, with its repeats written out.

    Parameters
    ----------
    text : str
        Sequence, for example `Inc:12:P 2{aTFA:6:P Gama:8:P}`.
    words : mapping of str to Word
        Names that may be used.

    Raises
    ------
    ValueError
        The text breaks the grammar, names a word that is not in the table, gives a word fewer than 2 or more than
        `MAX_BITS` bits, or has no word or more than `MAX_WORDS` words.
    """
    levels: list[tuple[int, list[SequenceItem]]] = [(1, [])]
    at = 0
    text = text.strip(" \t\r\n,;")
    while at < len(text):
        found = _TOKEN.match(text, at)
        if found is None:
            raise ValueError(
                f"sequence: cannot read {text[at : at + 20]!r}; write NAME:BITS:P, or a number and braces, 3{{...}}"
            )
        repeat, closed, name, bits, parity = found.groups()
        if repeat is not None:
            levels.append((int(repeat or 1), []))
        elif closed:
            if len(levels) == 1:
                raise ValueError(f"sequence: one closing brace too many before {text[found.end() :][:20]!r}")
            times, inner = levels.pop()
            levels[-1][1].extend(inner * min(times, MAX_WORDS + 1))
        else:
            levels[-1][1].append(_item(name, bits, parity in ("P", "p"), words))
        if len(levels[-1][1]) > MAX_WORDS:
            raise ValueError(f"sequence: more than {MAX_WORDS} words in one pass")
        at = found.end()
    if len(levels) > 1:
        raise ValueError(f"sequence: {len(levels) - 1} braces are not closed")
    if not levels[0][1]:
        raise ValueError("sequence: at least one word is needed; write NAME, NAME:BITS or NAME:BITS:P")
    return tuple(levels[0][1])


def written(items: tuple[SequenceItem, ...]) -> str:
    """Return the text of a sequence, which `parse` reads back; a word repeated in a row is written with a count."""
    parts = []
    for item, count in _runs(items):
        one = f"{item.name}:{item.bits}{':P' if item.parity else ''}"
        parts.append(one if count == 1 else f"{count}{{{one}}}")
    return " ".join(parts)


def _item(name: str, bits: str | None, parity: bool, words: Mapping[str, Word]) -> SequenceItem:
    alike = [one for one in words if one.lower() == name.lower()]
    name = alike[0] if name not in words and len(alike) == 1 else name
    if name not in words:
        raise ValueError(f"sequence: {unknown_key(name, words, 'words')}")
    length = int(bits) if bits else words[name].bits
    if not 2 <= length <= MAX_BITS:
        raise ValueError(f"sequence: {name} needs 2 to {MAX_BITS} bits, got {length}")
    return SequenceItem(name, length, parity)


def _runs(items: tuple[SequenceItem, ...]) -> Iterator[tuple[SequenceItem, int]]:
    start = 0
    for k in range(1, len(items) + 1):
        if k == len(items) or items[k] != items[start]:
            yield items[start], k - start
            start = k
