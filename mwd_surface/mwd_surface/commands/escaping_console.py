# SPDX-License-Identifier: Apache-2.0
"""
Console of the command line, which translates texts to the chosen language and escapes hidden characters.

`speech` describes the translation, and `terminal.PrintableStream` the reason for escaping.
"""

from __future__ import annotations

from typing import Any

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook, RenderResult
from rich.segment import Segment

from mwd_sensors.core.foreign_text import printable
from mwd_surface.commands.speech import say, spoken
from mwd_surface.commands.spoken_table import spoken_text


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
