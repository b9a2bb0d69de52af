# SPDX-License-Identifier: Apache-2.0
"""Table of the command line whose title, headings and cells are in the chosen language."""

from __future__ import annotations

from typing import Any

from rich.table import Table
from rich.text import Text

from mwd_surface.commands.speech import say


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
