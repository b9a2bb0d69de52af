# SPDX-License-Identifier: Apache-2.0
"""
Languages: reading of the catalogues, and translation of sentences before people read them.

The code writes each sentence in English. The sentence stays English in messages, logs and recordings; page, report and
command line translate it for people. A catalogue (`zh_CN.po`) has every text of the sources. A text with values is a
template: ``no data from the sonde for more than {limit} s``. `Language.say` finds the template of a sentence,
translates the values in the same way, and puts them into the translation of the template. Values that people have typed
(`TYPED`) are not translated. To add a language, add its catalogue. The texts that only the command line prints have a
separate catalogue (`commands/zh_CN.po`), which the page does not load; `language_of_commands` loads both.

The page translates in the same way with the same catalogue (`page/static/words.js`); a test compares the translations.
"""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

ENGLISH = "en"
_FOLDER = Path(__file__).parent
_OF_COMMANDS = _FOLDER / "commands"
# Variables that choose the language of the command line, in the order in which gettext reads them.
VARIABLES = ("LANGUAGE", "LC_ALL", "LC_MESSAGES", "LANG")
# Entry of a catalogue: comment lines, English text, translation.
_MESSAGE = re.compile(r'((?:^#.*\n)*)^msgid ((?:".*"\n)+)msgstr ((?:".*"\n?)+)', re.MULTILINE)
_PLACE = re.compile(r"\{(\w+)\}")
_NAMED = re.compile(r"\{[a-z]\w*\}")
# A number with its unit, which needs no translation.
_QUANTITY = re.compile(
    r"^[+\-−]?\d[\d.,:e+\-−]*( ?(%|°|deg|nT|uT|mG|T|s|m|ft|g|dB|Hz|MB|GB|kN|bar|min|h|ppm|urad|sigma|rad/s|m/s\^2|deg/h"
    r"|deg/s|r/min))?$"
)
# Marks between sentences and between the members of a list. A catalogue has the marks that differ in its language.
SENTENCES = "; "
MARKS = (SENTENCES, ": ", ", ", " or ", " and ", " · ")
# Names of the values that people have typed: names of wells, plans, controllers and people, and reasons. These values
# are not translated.
TYPED = frozenset(
    (
        "name",
        "name1",
        "name2",
        "operator",
        "operator_name",
        "because",
        "plan",
        "well",
        "wellbore",
        "path",
        "file",
        "logo",
    )
)
# Smallest number of letters in the fixed parts of a template if the translation of a value is unknown: for a template
# that begins with a fixed part, and for a template that begins with a value.
_LEAST, _LEAST_BEHIND = 4, 6
_DEPTH = 6  # largest depth of sentences within sentences
_JOINED = 3  # largest number of parts between "; " that are read as one sentence
# Largest work for one sentence: number of letters for which templates are searched. A test shows that every text of the
# sources needs less than a fifth. A longer search ends with the best translation found so far, so that a text from
# outside cannot block the page.
_WORK = 80_000
_EACH = 100  # work counted for each search, in addition to the number of letters of the text


class _Template(NamedTuple):
    """A text with values: its fixed parts, the names of the values between them, and its translation."""

    parts: tuple[str, ...]
    names: tuple[str, ...]
    translated: str
    longest: str
    known: int  #: letters of the fixed parts

    def values(self, text: str, *, last: bool) -> dict[str, str] | None:
        """
        Return the values that a text has at the places of the template; None if the text does not fit the template.

        last: search the fixed parts from the right instead of from the left. The results differ if a value contains the
        words of a fixed part.
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

    def readings(self, text: str) -> Iterator[dict[str, str]]:
        """
        Yield the values that the places of this template may have in a text; nothing if the text does not fit.

        The places are filled from the left, and once more from the right if this gives other values.
        """
        first = self.values(text, last=False)
        if first is not None:
            yield first
        # Without a fixed part between two values both directions give the same values.
        other = self.values(text, last=True) if len(self.parts) > 2 else None
        if other is not None and other != first:
            yield other


class _Translation(NamedTuple):
    """Translation of one English text."""

    text: str
    unknown: int  #: letters without a translation
    known: float  #: letters in the template's fixed parts


class Language:
    """
    One language.

    Parameters
    ----------
    code : str
        Code in the file name of the catalogue, for example ``zh_CN``.
    entries : mapping
        Translation of each English text; empty for English.
    decimal, name : str
        Decimal mark, and name of the language in the language; by default as in Babel for the code.
    """

    def __init__(self, code: str, entries: Mapping[str, str], decimal: str = "", name: str = "") -> None:
        self.code, self.entries, self._decimal, self._own_name = code, dict(entries), decimal, name
        self.say = functools.lru_cache(maxsize=4000)(self._say)

    @functools.cached_property
    def templates(self) -> list[_Template]:
        """Templates of the catalogue, sorted by the number of letters in their fixed parts, the largest first."""
        found = (_template(*entry) for entry in self.entries.items() if _NAMED.search(entry[0]))
        return sorted(found, key=lambda template: -template.known)

    @functools.cached_property
    def joined_templates(self) -> list[_Template]:
        """Templates whose fixed parts contain "; ", the mark between sentences."""
        return [one for one in self.templates if any(SENTENCES in part for part in one.parts)]

    @functools.cached_property
    def decimal(self) -> str:
        """Decimal mark of the language."""
        if self._decimal or self.code == ENGLISH:
            return self._decimal or "."
        # Import Babel only if needed: the import takes longer than printing the help of a command.
        from babel.numbers import get_decimal_symbol

        return get_decimal_symbol(self.code)

    @functools.cached_property
    def name(self) -> str:
        """Name of the language in the language, for example "English"."""
        if self._own_name or self.code == ENGLISH:
            return self._own_name or "English"
        from babel import Locale

        return str(Locale.parse(self.code).get_language_name())

    def _say(self, text: str) -> str:
        """Return a sentence in this language; parts of the sentence without a translation stay English."""
        return self._read(text).text if self.entries else text

    def unknown(self, text: str) -> int:
        """Return the number of letters of a sentence without a translation: letters of names, paths, other texts."""
        return self._read(text).unknown

    def _read(self, text: str) -> _Translation:
        return _TemplateSearch(self).read(text, _DEPTH)

    def number(self, text: str) -> str:
        """Return the text of a number, which has a decimal point, with the decimal mark of this language."""
        return text if self.decimal == "." else text.replace(".", self.decimal)

    def table(self) -> dict[str, Any]:
        """Return JSON data for the page: code, decimal mark, entries, and the names of all languages."""
        return {
            "code": self.code,
            "decimal": self.decimal,
            "languages": [[code, name] for code, name in languages().items()],
            "entries": self.entries,
        }


class _TemplateSearch:
    """Search for the translation of one text; the work is limited by `_WORK`."""

    def __init__(self, language: Language) -> None:
        self._language = language
        self._known: dict[tuple[str, int, bool], _Translation] = {}
        self._work = _WORK

    def read(self, text: str, depth: int, *, whole: bool = False) -> _Translation:
        """
        Return the translation of a text.

        depth: number of levels of sentences within sentences that are translated. whole: translate the text as one
        sentence, not as a list of sentences.
        """
        entries = self._language.entries
        if text in entries:
            return _Translation(entries[text], 0, float("inf"))
        if _QUANTITY.match(text):
            return _Translation(self._language.number(re.sub(r" deg$", "°", text).replace(" sigma", "σ")), 0, 0)
        # A single letter is the name of an axis.
        unread = _Translation(text, _letters(text) if len(text) > 1 else 0, 0)
        if not unread.unknown or not depth:
            return unread
        if (text, depth, whole) not in self._known:
            # A search with `whole` is not counted, because it tries only the few `joined_templates`.
            self._work -= 0 if whole else len(text) + _EACH
            if self._work < 0:
                return unread
            templates = self._language.joined_templates if whole else self._language.templates
            best = self._by_template(templates, text, depth, unread)
            self._known[text, depth, whole] = self._by_parts(text, depth, best) if best.unknown and not whole else best
        return self._known[text, depth, whole]

    def _by_template(self, templates: list[_Template], text: str, depth: int, best: _Translation) -> _Translation:
        """
        Return the translation by the template with the fewest unknown letters, then with the most fixed letters.

        Return `best`, the translation found so far, if no template gives a better one.
        """
        for template in [one for one in templates if one.longest in text]:
            for values in template.readings(text):
                read = {name: self._value(name, value, depth, template) for name, value in values.items()}
                unknown = sum(part.unknown for part in read.values())
                # A short template, such as "{a} is {b}", may fit by chance if its values have no translation.
                if unknown and template.known < (_LEAST if template.parts[0] else _LEAST_BEHIND):
                    continue
                if (-unknown, template.known) > (-best.unknown, best.known):
                    filled = _filled(template.translated, {name: part.text for name, part in read.items()})
                    best = _Translation(filled, unknown, template.known)
                if not unknown:
                    return best
        return best

    def _value(self, name: str, value: str, depth: int, template: _Template) -> _Translation:
        if name in TYPED:
            return _Translation(value, 0 if template.known >= _LEAST else _letters(value), 0)
        return self.read(value, depth - 1)

    def _by_parts(self, text: str, depth: int, best: _Translation) -> _Translation:
        """Return the translation of a text as a list; `best` if a member of the list has no translation."""
        for mark in MARKS:
            if mark in text and (read := self._listed(mark, text.split(mark), depth - 1)) is not None:
                return _Translation(self._language.entries.get(mark, mark).join(read), 0, 0)
        return best

    def _listed(self, mark: str, pieces: list[str], depth: int) -> list[str] | None:
        """
        Return the translations of the members of a list; None if a member has no translation.

        mark: mark between the pieces. A member consists of several pieces if a sentence contains the mark.
        """
        if not pieces:
            return []
        for count in range(1, min(len(pieces), _JOINED if mark == SENTENCES else 1) + 1):
            member = self.read(mark.join(pieces[:count]), depth, whole=count > 1)
            rest = None if member.unknown else self._listed(mark, pieces[count:], depth)
            if rest is not None:
                return [member.text, *rest]
        return None


def _letters(text: str) -> int:
    return sum(letter.isalpha() for letter in text)


def _filled(text: str, values: Mapping[str, str]) -> str:
    return _PLACE.sub(lambda m: values.get(m[1], m[0]), text)


def _template(english: str, translated: str) -> _Template:
    parts = tuple(_PLACE.split(english)[::2])
    return _Template(
        parts, tuple(_PLACE.findall(english)), translated, max(parts, key=len), sum(_letters(part) for part in parts)
    )


def codes() -> tuple[str, ...]:
    """Return the codes of English and of every language with a catalogue, English first."""
    return (ENGLISH, *sorted(path.stem for path in _FOLDER.glob("*.po")))


@functools.cache
def languages() -> dict[str, str]:
    """Return the name of every language in the language itself, by its code, English first."""
    return {code: _catalogue(code).name for code in codes()}


def language(code: str) -> Language:
    """
    Return a language by its code, also in the forms ``zh-CN`` and ``zh_CN.UTF-8``, or by its part before `_`.

    Raises
    ------
    ValueError
        There is no catalogue for the language; the message names the codes of all languages.
    """
    return _catalogue(_name(code))


def language_of_commands(environment: Mapping[str, str]) -> Language:
    """
    Return the language of the command line from the environment variables.

    The rules of gettext are used: the first variable of `VARIABLES` that is set is used. The variable may list several
    languages, separated by colons; the first language with a catalogue is used, or else English.
    """
    for code in next((environment[one] for one in VARIABLES if environment.get(one)), "").split(":"):
        try:
            name = _name(code)
        except ValueError:
            continue
        return _with_commands(name)
    return _catalogue(ENGLISH)


def _name(code: str) -> str:
    """Return the name of the catalogue for a code, one of `codes`; ValueError if there is no catalogue for it."""
    wanted = code.partition(".")[0].replace("-", "_")
    if wanted in ("", "C", "POSIX"):
        return ENGLISH
    known = codes()
    short = wanted.partition("_")[0].lower()
    found = wanted if wanted in known else next((one for one in known if one.partition("_")[0].lower() == short), None)
    if found is None:
        raise ValueError(f"language: {code[:40]!r} has no catalogue; choose one of {', '.join(known)}")
    return found


@functools.cache
def _catalogue(name: str) -> Language:
    """Return the language of a catalogue; name: one of `codes`, never a code from a request, as results are cached."""
    return Language(name, {} if name == ENGLISH else read_catalogue(_FOLDER / f"{name}.po"))


@functools.cache
def _with_commands(name: str) -> Language:
    """Return a language whose entries include the texts of the command line; name: one of `codes`."""
    path = _OF_COMMANDS / f"{name}.po"
    more = read_catalogue(path) if path.exists() else {}
    return Language(name, {**_catalogue(name).entries, **more}) if more else _catalogue(name)


def read_catalogue(path: Path) -> dict[str, str]:
    """
    Return the translations of a catalogue by English text, without empty translations and without fuzzy ones.

    Babel is not used here, because its import and its reading take 0.4 s, longer than the help of a command may take. A
    test compares the result with Babel's.
    """
    found = {}
    for comment, english, translated in _MESSAGE.findall(path.read_text(encoding="utf-8")):
        key, said = _unquoted(english), _unquoted(translated)
        if key and said and not ("fuzzy" in comment and re.search(r"^#,.*\bfuzzy\b", comment, re.MULTILINE)):
            found[key] = said
    return found


def _unquoted(lines: str) -> str:
    text = lines.strip()[1:-1].replace('"\n"', "")
    return str(ast.literal_eval(f'"{text}"')) if "\\" in text else text
