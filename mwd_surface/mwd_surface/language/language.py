# SPDX-License-Identifier: Apache-2.0
"""
Languages: the catalogue of each, and the translation of a sentence at the edge of the program.

Sentences are written in English where their condition is known, and travel so in messages, logs and recordings. Page,
report and command line translate them for people. A catalogue (`zh_CN.po`) has every text of the sources; a text with
values is a template: ``no data from the sonde for more than {limit} s``. `Language.say` finds the template of a
sentence, translates its values in the same way, and puts them into the translation. To add a language, add its file.

The page does the same with the same table (`page/static/words.js`); a test compares the two.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

ENGLISH = "en"
_FOLDER = Path(__file__).parent
_PLACE = re.compile(r"\{(\w+)\}")
_NAMED = re.compile(r"\{[a-z]\w*\}")
# A number with its unit, which needs no translation.
_QUANTITY = re.compile(
    r"^[+\-−]?\d[\d.,:e+\-−]*( ?(%|°|deg|nT|uT|mG|T|s|m|ft|g|dB|Hz|MB|GB|kN|bar|min|h|ppm|urad|sigma|rad/s|m/s\^2|deg/h"
    r"|deg/s|r/min))?$"
)
# Marks that join sentences and lists; the catalogue has those that differ in a language.
MARKS = ("; ", ": ", ", ", " or ", " and ", " at ", " · ")
_LEAST = 5  # letters of a template
_DEPTH = 6  # of sentences within sentences


class _Template(NamedTuple):
    """A text with values: its fixed parts, the names of the values between them, and its translation."""

    parts: tuple[str, ...]
    names: tuple[str, ...]
    translated: str
    longest: str
    known: int  #: letters of the fixed parts

    def values(self, text: str, *, last: bool) -> dict[str, str] | None:
        """
        Return the values of a text; None if it is another sentence.

        Fixed parts are found in one pass, from the left or, if `last`, from the right: a value may contain such a part.
        """
        head, *middle, tail = self.parts
        if len(text) < len(head) + len(tail) or not (text.startswith(head) and text.endswith(tail)):
            return None
        rest, found = text[len(head) : len(text) - len(tail)], []
        for part in reversed(middle) if last else middle:
            if part not in rest:
                return None
            before, _, after = rest.rpartition(part) if last else rest.partition(part)
            found.append(after if last else before)
            rest = before if last else after
        found.append(rest)
        values: dict[str, str] = {}
        for name, value in zip(self.names, reversed(found) if last else found, strict=True):
            if values.setdefault(name, value) != value:
                return None
        return values


class _Reading(NamedTuple):
    """Translation of a text, with the number of its letters that no template explains."""

    text: str
    unknown: int
    known: float


class Language:
    """
    One language.

    Parameters
    ----------
    code : str
        As in the name of its catalogue, for example ``zh_CN``.
    entries : mapping
        From English to the language; empty for English.
    decimal : str
        Decimal mark.
    name : str
        Name of the language in itself.
    """

    def __init__(self, code: str, entries: Mapping[str, str], decimal: str = ".", name: str = "English") -> None:
        self.code, self.entries, self.decimal, self.name = code, dict(entries), decimal, name
        self._templates = [_template(*entry) for entry in self.entries.items() if _NAMED.search(entry[0])]
        self.say = functools.lru_cache(maxsize=4000)(self._say)

    def _say(self, text: str) -> str:
        """Return a sentence in this language; parts of it that the catalogue does not have stay English."""
        return self._read(text, _DEPTH).text if self.entries else text

    def unknown(self, text: str) -> int:
        """Return the number of letters of a sentence that the catalogue does not explain: names, paths, other texts."""
        return self._read(text, _DEPTH).unknown

    def number(self, text: str) -> str:
        """Return a number, written with a point, with the decimal mark of this language."""
        return text if self.decimal == "." else text.replace(".", self.decimal)

    def _read(self, text: str, depth: int) -> _Reading:
        if text in self.entries:
            return _Reading(self.entries[text], 0, float("inf"))
        if _QUANTITY.match(text):
            return _Reading(self.number(re.sub(r" deg$", "°", text).replace(" sigma", "σ")), 0, 0)
        # A single letter is the name of an axis.
        best = _Reading(text, _letters(text) if len(text) > 1 else 0, 0)
        if not best.unknown or not depth:
            return best
        fitting = [template for template in self._templates if template.longest in text]
        for template, last in itertools.product(fitting, (False, True)):
            values = template.values(text, last=last)
            if values is None:
                continue
            read = {name: self._read(value, depth - 1) for name, value in values.items()}
            unknown = sum(part.unknown for part in read.values())
            # A short template, such as "{a} is {b}", fits by chance where its values are not known either.
            if unknown and template.known < _LEAST:
                continue
            if (-unknown, template.known) > (-best.unknown, best.known):
                filled = _filled(template.translated, {name: part.text for name, part in read.items()})
                best = _Reading(filled, unknown, template.known)
        for mark in MARKS:
            if not best.unknown or mark not in text:
                continue
            pieces = [self._read(piece, depth - 1) for piece in text.split(mark)]
            unknown = sum(piece.unknown for piece in pieces)
            if unknown < best.unknown:
                best = _Reading(self.entries.get(mark, mark).join(piece.text for piece in pieces), unknown, 0)
        return best

    def table(self) -> dict[str, Any]:
        """Return the language as the page needs it, as JSON data."""
        return {
            "code": self.code,
            "decimal": self.decimal,
            "languages": [[code, name] for code, name in languages().items()],
            "entries": self.entries,
        }


def _letters(text: str) -> int:
    return sum(letter.isalpha() for letter in text)


def _filled(text: str, values: Mapping[str, str]) -> str:
    return _PLACE.sub(lambda m: values.get(m[1], m[0]), text)


def _template(english: str, translated: str) -> _Template:
    parts = tuple(_PLACE.split(english)[::2])
    return _Template(
        parts, tuple(_PLACE.findall(english)), translated, max(parts, key=len), sum(_letters(part) for part in parts)
    )


@functools.cache
def languages() -> dict[str, str]:
    """Return the code and the own name of every language that there is a catalogue for, English first."""
    from babel import Locale

    codes = sorted(path.stem for path in _FOLDER.glob("*.po"))
    return {ENGLISH: "English", **{code: str(Locale.parse(code).get_language_name()) for code in codes}}


@functools.cache
def language(code: str) -> Language:
    """
    Return a language by its code, also in the forms ``zh-CN`` and ``zh_CN.UTF-8``, or by its first part.

    Raises
    ------
    ValueError
        There is no catalogue for it; the message names those that there are.
    """
    wanted = code.partition(".")[0].replace("-", "_")
    if wanted in ("", "C", "POSIX") or wanted.partition("_")[0] == ENGLISH:
        return Language(ENGLISH, {})
    from babel import Locale
    from babel.messages.pofile import read_po
    from babel.numbers import get_decimal_symbol

    known = languages()
    short = wanted.partition("_")[0].lower()
    found = next((one for one in known if one == wanted), None)
    found = found or next((one for one in known if one.partition("_")[0].lower() == short), None)
    if found is None:
        raise ValueError(f"language: {code!r} has no catalogue; choose one of {', '.join(known)}")
    with (_FOLDER / f"{found}.po").open("rb") as file:
        messages = read_po(file, locale=found)
    entries = {str(message.id): str(message.string) for message in messages if message.id and message.string}
    return Language(found, entries, get_decimal_symbol(Locale.parse(found)), known[found])
