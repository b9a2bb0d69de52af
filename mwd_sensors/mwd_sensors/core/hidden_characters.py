# SPDX-License-Identifier: Apache-2.0
"""
Find characters that a reader does not see, or that change how the rest of a text is shown.

These are control characters, which a terminal obeys; marks that reverse the direction of writing; characters without
width or shape; and codes that are not text. Such characters can make two different names look alike.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator

_UNUSUAL = re.compile(r"[^\n\t -~]")
# Letters, marks and selectors without a shape, which Unicode does not count as control or format characters.
_WITHOUT_SHAPE = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u2800\u3164\uffa0\U0001d159\U000e0100-\U000e01ef]"
)
# Zero-width non-joiner and joiner: Persian, Hindi and other scripts write them between letters to change the shape of
# the letters. The codes of these scripts are not below `_FIRST_SCRIPT`.
_JOINERS, _FIRST_SCRIPT = "\u200c\u200d", "\u0370"


def _is_hidden(found: re.Match[str]) -> bool:
    character, text = found[0], found.string
    if character in _JOINERS:
        beside = text[max(found.start() - 1, 0) : found.start()], text[found.end() : found.end() + 1]
        return not all(one >= _FIRST_SCRIPT and one.isprintable() for one in beside)
    shown = character.isprintable() or unicodedata.category(character) == "Zs"
    return not shown or _WITHOUT_SHAPE.match(character) is not None


def _code(character: str) -> str:
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def hidden(text: str) -> Iterator[str]:
    """Yield the codes of the hidden characters of a text, except tab and line end."""
    return (_code(found[0]) for found in _UNUSUAL.finditer(text) if _is_hidden(found))


def escaped(text: str) -> str:
    """Return a text in which codes replace all hidden characters, except tab and line end."""
    return _UNUSUAL.sub(lambda found: _code(found[0]) if _is_hidden(found) else found[0], text)
