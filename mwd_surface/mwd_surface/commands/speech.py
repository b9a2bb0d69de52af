# SPDX-License-Identifier: Apache-2.0
"""
Language of the command line: texts are translated when they are printed, as on the page.

`mwd --language CODE` or the variables of gettext (`LANGUAGE`, `LC_ALL`, `LC_MESSAGES`, `LANG`) choose the language.
"""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING

from mwd_surface.language.language import Language, language, language_of_commands

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Pattern of a part of a line: marks and spaces, the words, marks and spaces.
_AROUND = re.compile(r"([\s:;,.(→•-]*)(.*?)([\s:;,.)]*)", re.DOTALL)

# Pattern of a line with the name of a file, and a sentence about the file.
_NAMED = re.compile(r"(\s*[^\s:]+): (.+)")


def choose(code: str) -> None:
    """
    Choose the language of this process and of its child processes.

    Raises
    ------
    ValueError
        The language has no catalogue.
    """
    os.environ["LANGUAGE"] = language(code).code


def spoken() -> Language:
    """Return the language that the user has chosen for the commands."""
    return language_of_commands(os.environ)


def say(text: str) -> str:
    """Return a text in the chosen language, line by line; spaces and marks around the words are kept."""
    said = spoken()
    if not said.entries:
        return text
    return "\n".join(_line(said, line) for line in text.split("\n"))


def spoken_figure(figure: Figure) -> Figure:
    """Translate the texts of a figure into the chosen language; return the figure."""
    from mwd_surface.plots.drawing import translate

    return translate(figure, say) if spoken().entries else figure


def _line(said: Language, line: str) -> str:
    whole = line.strip()
    found = said.say(whole)
    if found != whole or not whole:
        return line.replace(whole, found, 1) if whole else line
    if named := _NAMED.fullmatch(line):
        return f"{named[1]}{said.entries.get(': ', ': ')}{_line(said, named[2])}"
    match = _AROUND.fullmatch(line)
    before, words, after = match.groups() if match else ("", line, "")
    marks = [said.entries.get(mark, mark) for mark in (before, after)]
    return f"{marks[0]}{said.say(words)}{marks[1]}"
