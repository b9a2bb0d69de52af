# SPDX-License-Identifier: Apache-2.0
"""
Console and table of the command line, which translate texts to the chosen language and escape hidden characters.

`speech` describes the translation, and `terminal.PrintableStream` the reason for escaping.
"""

from __future__ import annotations

from typing import Any

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook, RenderResult
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from mwd_sensors.core.foreign_text import printable
from mwd_surface.commands.speech import say, spoken


def spoken_text(said: Any) -> Any:
    """Return a string or rich Text in the chosen language, translated style by style; other objects are unchanged."""
    if isinstance(said, str):
        return say(said) if "[" not in said else spoken_text(Text.from_markup(said))
    if not isinstance(said, Text) or not said.plain.strip():
        return said
    if not said.spans:
        return Text(say(said.plain), style=said.style, no_wrap=said.no_wrap, overflow=said.overflow)
    edges = sorted({edge for span in said.spans for edge in (span.start, span.end)} - {0, len(said.plain)})
    made = Text(no_wrap=said.no_wrap, overflow=said.overflow)
    for piece in said.divide(edges):
        style = piece.spans[0].style if piece.spans else piece.style
        made.append(say(piece.plain), style=style)
    return made


class SpokenTable(Table):
    """Table in the chosen language."""

    def __init__(self, *headers: Any, title: Any = None, **options: Any) -> None:
        super().__init__(*headers, title=spoken_text(title), **options)

    def add_column(self, header: Any = "", *arguments: Any, **options: Any) -> None:
        """Add a column with a translated heading."""
        super().add_column(spoken_text(header), *arguments, **options)

    def add_row(self, *cells: Any, **options: Any) -> None:
        """Add a row with translated cells."""
        super().add_row(*map(spoken_text, cells), **options)


class _Escaped:
    """Renderable whose text has all hidden characters escaped, including colour codes; its style is kept."""

    def __init__(self, made: ConsoleRenderable) -> None:
        self._made = made

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for part in console.render(self._made, options):
            yield part if part.control else Segment(printable(part.text), part.style)


class _EscapeAll(RenderHook):
    """Hook of a rich console that escapes hidden characters in all printed text."""

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        """Return renderables with escaped text, which the console prints in place of `renderables`."""
        return [_Escaped(one) for one in renderables]


class _Spoken(Console):
    """Console that prints texts in the chosen language."""

    def print(self, *objects: Any, markup: bool | None = None, **options: Any) -> None:
        """Print texts in the chosen language; a table (`SpokenTable`) is translated already."""
        if spoken().entries:
            objects = tuple(
                say(one) if markup is False and isinstance(one, str) else spoken_text(one) for one in objects
            )
        super().print(*objects, markup=markup, **options)


def escaping_console(*, stderr: bool) -> Console:
    """Return a console on standard output or error whose text is translated and escaped."""
    console = _Spoken(stderr=stderr, soft_wrap=True, highlight=False)
    console.push_render_hook(_EscapeAll())
    return console
