# SPDX-License-Identifier: Apache-2.0
"""
Help of the commands in the chosen language: headings, paragraphs, options and their defaults.

The English texts are the docstrings of the commands and the descriptions of their options. A paragraph is one text of
the translation catalogue.
"""

from __future__ import annotations

import inspect
import re
import textwrap
import unicodedata
from collections.abc import Iterator, Sequence
from typing import Any

import typer
from typer.core import TyperGroup

from mwd_surface.commands.speech import say, spoken

# Pieces of a line: spaces, a single wide (Chinese) character, or a word of other characters.
_PIECES = re.compile(r"\s+|[\u2e80-\uffef…—]|[^\s\u2e80-\uffef…—]+")
# Marks that must not begin a line.
_CLOSING = "。，、；：）！？」…"
# Description of an option, and the default, range or "required" that typer appends in brackets.
_EXTRA = re.compile(r"(.*?)\s*\[((?:default: |required|env var: |x[<>]|[^\[\]]*<=?x)[^\[\]]*)\]", re.DOTALL)
_SHORTEST = 20  # smallest width of the column of descriptions
_LONGEST = 64  # largest width of the description of a command in a list


def width_of(text: str) -> int:
    """Return the width of a text on a terminal, in columns; a Chinese character has two columns."""
    return sum(2 if unicodedata.east_asian_width(letter) in "WF" else 1 for letter in text)


def wrapped(text: str, width: int) -> list[str]:
    """Return the lines of a paragraph; a line may break between Chinese characters, but not before a closing mark."""
    lines, line = [], ""
    for piece in _PIECES.findall(text):
        if line and piece[0] not in _CLOSING and width_of(line + piece.rstrip()) > width:
            lines.append(line.rstrip())
            line = ""
        line += piece if line else piece.lstrip()
    return [*lines, line.rstrip()] if line.strip() else lines


def paragraphs(text: str) -> Iterator[tuple[str, bool]]:
    """Yield each paragraph of a help text, and whether its line breaks are kept; if not, the paragraph is one line."""
    for block in re.split(r"\n\s*\n", inspect.cleandoc(text).partition("\f")[0]):
        fixed = block.lstrip().startswith("\b")
        yield (block.partition("\b")[2].strip("\n") if fixed else " ".join(block.split())), fixed


def cut(text: str, width: int) -> str:
    """Return a text, or its beginning with an ellipsis if the text is wider than `width` columns."""
    if width_of(text) <= width:
        return text
    while width_of(text) > width - 2:
        text = text[:-1]
    return text.rstrip("，、；：。 ") + "…"


class SpokenHelp(typer.Context.formatter_class):  # type: ignore[misc, valid-type]
    """Formatter of the help page in the chosen language; in English the page is unchanged."""

    def write_usage(self, prog: str, args: str = "", prefix: str | None = None) -> None:
        """Write the line that shows the arguments of the command."""
        super().write_usage(prog, args, say(prefix or "Usage: "))

    def write_heading(self, heading: str) -> None:
        """Write the heading of a section."""
        said = spoken().entries
        self.write(f"{'':>{self.current_indent}}{said.get(heading, heading)}{said.get(': ', ':')}\n")

    def write_text(self, text: str) -> None:
        """Write the paragraphs of a help text, translated and wrapped."""
        if not spoken().entries:
            super().write_text(text)
            return
        indent = " " * self.current_indent
        made = []
        for words, fixed in paragraphs(text):
            lines = [say(line) for line in words.splitlines()] if fixed else wrapped(say(words), self._room())
            made.append("\n".join(f"{indent}{line}" for line in lines))
        self.write("\n\n".join(made) + "\n")

    def write_dl(self, rows: Sequence[tuple[str, str]], col_max: int = 30, col_spacing: int = 2) -> None:
        """Write a list of options, arguments or commands, each with its description."""
        if not spoken().entries:
            super().write_dl(rows, col_max, col_spacing)
            return
        first = min(max(width_of(name) for name, _ in rows), col_max) + col_spacing
        room, indent = max(self._room() - first, _SHORTEST), " " * self.current_indent
        for name, meaning in rows:
            lines = wrapped(_meaning(meaning), room)
            if width_of(name) > first - col_spacing or not lines:
                lines = ["", *lines]
            head = f"{name}{' ' * (first - width_of(name))}" if lines[0] else name
            self.write(f"{indent}{head}{lines[0]}\n")
            self.write("".join(f"{indent}{' ' * first}{line}\n" for line in lines[1:]))

    def _room(self) -> int:
        # Keep the last column free for a punctuation mark, which must not begin a line.
        return int(self.width) - int(self.current_indent) - 1


def _meaning(text: str) -> str:
    """Return the description of an option, with its default, in the chosen language."""
    words = " ".join(text.split())
    if not (match := _EXTRA.fullmatch(words)):
        return say(words)
    template = spoken().entries.get("default: {default}", "default: {default}")
    extra = [
        template.replace("{default}", part.removeprefix("default: ")) if part.startswith("default: ") else say(part)
        for part in match[2].split("; ")
    ]
    return f"{say(match[1])}  [{'；'.join(extra)}]".strip()


class SpokenContext(TyperGroup.context_class):  # type: ignore[misc, valid-type]
    """Context of a command whose help page is in the chosen language."""

    formatter_class = SpokenHelp


def summary(source: Any, limit: int) -> str:
    """
    Return the description of a command for a list of commands, in the chosen language.

    source: function or group of the command; limit: largest width of an English description, columns. A translated
    description is wrapped by `SpokenHelp`.
    """
    described: Any = source.info.help if isinstance(source, typer.Typer) else source.__doc__
    text = next(paragraphs(described))[0]
    if spoken().entries:
        return cut(say(text), _LONGEST)
    return textwrap.shorten(re.split(r"(?<=\.)\s", text)[0], limit, placeholder="...")


def with_spoken_help(command: Any) -> Any:
    """Return a command and its subcommands with help in the chosen language."""
    command.context_class = SpokenContext
    if spoken().entries and command.help:
        command.short_help = cut(say(next(paragraphs(command.help))[0]), _LONGEST)
    for below in getattr(command, "commands", {}).values():
        with_spoken_help(below)
    return command
