# SPDX-License-Identifier: Apache-2.0
"""
Parts of a report: sections with text, tables and drawings, as texts and printed numbers.

HTML and PDF reports are laid out from the same parts, so their numbers cannot differ. To add a section, write a
function that returns a `Section` and add it to `SECTIONS` of `report_content`, or pass the section itself to
`survey_table(..., sections=...)` if its data are not part of the survey list.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Tints of a cell: within its limit, doubtful, rejected; they also differ in brightness, for black and white print.
GOOD, DOUBTFUL, REJECT = "good", "doubtful", "reject"
TINTS = {GOOD: "#dff0e6", DOUBTFUL: "#ffe8a3", REJECT: "#f6b8a2"}


@dataclasses.dataclass(frozen=True)
class Sheet:
    """One table: heading, column titles and units, and rows of texts."""

    heading: str
    titles: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    #: for each row, "" or the reason why the row is highlighted ("projected", "not used", "by hand")
    marks: tuple[str, ...]
    words: tuple[int, ...] = ()  #: indices of the columns that contain text and are aligned left
    #: tint of single cells, by row and column; a key of `TINTS`
    tints: Mapping[tuple[int, int], str] = dataclasses.field(default_factory=dict)
    legend: str = ""  #: meaning of tints and marks, printed below the table


def sheet_of(
    heading: str,
    columns: Sequence[tuple[str, str]],
    rows: Sequence[tuple[str, ...]],
    marks: Sequence[str] = (),
    *,
    tints: Mapping[tuple[int, int], str] | None = None,
    legend: str = "",
) -> Sheet:
    """
    Return a table with columns of (title, unit).

    A column without unit is aligned left if a cell is not a number. marks: by default no row is highlighted.
    """
    titles, units = zip(*columns, strict=True)
    words = [k for k, unit in enumerate(units) if not unit and any(row[k] and not _is_number(row[k]) for row in rows)]
    return Sheet(
        heading, titles, units, tuple(rows), tuple(marks) or ("",) * len(rows), tuple(words), tints or {}, legend
    )


def _is_number(text: str) -> bool:
    return text.lstrip("-").replace(".", "", 1).isdecimal()


@dataclasses.dataclass(frozen=True)
class Drawing:
    """Figure with its caption, drawn when the report is written."""

    caption: str
    draw: Callable[[], Figure]
    wide: bool = False  #: whether the figure spans the full page width


@dataclasses.dataclass(frozen=True)
class Section:
    """Section of the report: heading, sentences, tables and drawings."""

    heading: str
    text: tuple[str, ...] = ()
    sheets: tuple[Sheet, ...] = ()
    drawings: tuple[Drawing, ...] = ()
    page: bool = False  #: whether the section begins on a new page


def table_section(
    heading: str,
    columns: Sequence[tuple[str, str]],
    rows: Sequence[tuple[str, ...]],
    marks: Sequence[str] = (),
    *,
    tints: Mapping[tuple[int, int], str] | None = None,
    legend: str = "",
    text: Sequence[str] = (),
) -> Section:
    """Return a section of one table with the same heading; text: sentences above it. Other arguments as `sheet_of`."""
    return Section(heading, tuple(text), (sheet_of(heading, columns, rows, marks, tints=tints, legend=legend),))
