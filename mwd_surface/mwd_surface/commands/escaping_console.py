# SPDX-License-Identifier: Apache-2.0
"""Console that escapes hidden characters in everything that it prints, see `terminal.PrintableStream`."""

from __future__ import annotations

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook, RenderResult
from rich.segment import Segment

from mwd_sensors.core.foreign_text import printable


class _Escaped:
    """Renderable whose text has all hidden characters escaped, including colour codes; its own style remains."""

    def __init__(self, made: ConsoleRenderable) -> None:
        self._made = made

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for part in console.render(self._made, options):
            yield part if part.control else Segment(printable(part.text), part.style)


class _EscapeAll(RenderHook):
    """Escape everything that a console prints."""

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        """Return what is printed instead."""
        return [_Escaped(one) for one in renderables]


def escaping_console(*, stderr: bool) -> Console:
    """Return a console on standard output or error whose text is escaped."""
    console = Console(stderr=stderr, soft_wrap=True, highlight=False)
    console.push_render_hook(_EscapeAll())
    return console
