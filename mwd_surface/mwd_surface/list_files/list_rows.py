# SPDX-License-Identifier: Apache-2.0
"""
Choice of the rows of a table that may be stations.

Tables of stations also have notes between the stations and, at the end, totals, closures, signatures and projections to
the bit. Such rows are left out, and one remark quotes them. A row with a mistyped number is kept, so that the number is
refused and the station does not disappear.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from mwd_surface.list_files import number_cells
from mwd_surface.list_files.grid_file import Row
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.remark import Remark, RemarkKind

# Words in the first column of rows of totals at the end of a list.
_TOTALS = number_cells.words_of(
    "total|totals|sum|max|maximum|min|minimum|mean|average|avg|end|td|summe|gesamt|итого|合计|总计|平均"
)
# Words in a row that extends a list to the bit or to the planned end, where no survey was taken.
_PROJECTION = re.compile(
    r"^\W*(?:proj|projected|projection|extrap|extrapolated|extrapolation|外推|预测)\W*$"
    r"|\b(?:proj\.?|projected|projection|extrapolated|extrapolation)\s+(?:survey\s+)?(?:to|at)\s+(?:the\s+)?(?:bit|td|total)\b",
    re.IGNORECASE,
)
_WORD = re.compile(r"[^\W\d_]{3,}")  # a cell that begins like this is a word, not a mistyped number
QUOTED = 4  # largest number of rows or values that a remark quotes
_PROJECTED_ROWS = 3  # largest number of rows after a note that announces a projection


def station_rows(name: str, rows: Sequence[Row], needed: Sequence[int]) -> tuple[list[Row], tuple[Remark, ...]]:
    """
    Return the rows that may be stations, and a remark that quotes the others, if there are any.

    name: name of the list; needed: indices of the columns of depth, inclination or dip, and azimuth, in this order.
    """
    depth = needed[0]
    kept: list[Row] = []
    notes: list[Row] = []
    # Number of rows kept before a note such as "projected to the bit", and number of last rows with such a note.
    announced = marked = 0
    for row in rows:
        cells = [row.cells[one] if one < len(row.cells) else "" for one in needed]
        numbers = [number_cells.looks_like_number(cell) for cell in cells]
        first = str(row.cells[0]).strip().lower().rstrip(":. ") if row.cells else ""
        word = str(cells[0]).strip().lower().rstrip(":. ")
        total = not numbers[0] and bool({first, word, *first.split()} & _TOTALS) and bool(kept)
        # A cell such as "Bottom hole: 360 m" contains a number, but is a note.
        worded = (word[:1].isalpha() or not any(c.isdigit() for c in word)) and not number_cells.is_null(cells[0])
        worded = worded and not number_cells.looks_like_number(cells[0])
        nothing = not any(numbers) and not (number_cells.is_null(cells[0]) and any(str(cell).strip() for cell in cells))
        nothing = nothing or (worded and (":" in word or not all(numbers[1:])))
        short = bool(kept) and numbers[0] and not any(numbers[1:]) and _is_sentence(row, kept[-1], depth)
        said = [str(cell) for cell in row.cells if not number_cells.looks_like_number(cell)]
        projected = any(_PROJECTION.search(text) for text in said)
        if total or nothing or short:
            notes.append(row)
            announced = len(kept) if projected else announced
        else:
            kept.append(row)
            marked = marked + 1 if projected else 0
    while len(kept) > 1 and _WORD.match(str(kept[-1].cells[depth] if depth < len(kept[-1].cells) else "").strip()):
        # Last rows with a word instead of a depth describe the whole hole, such as its closure. Farther up, such a
        # cell is a typing error.
        notes.append(kept.pop())
    below = len(kept) - announced if announced else 0
    count = max(marked, below if below <= _PROJECTED_ROWS else 0)
    if 0 < count < len(kept):
        # These rows continue the list to the bit; they were not measured.
        notes += kept[len(kept) - count :]
        del kept[len(kept) - count :]
    if not notes:
        return kept, ()
    quoted = "; ".join(repr(" ".join(str(c) for c in row.cells if str(c))[:60]) for row in notes[:QUOTED])
    text = f"{name}: {len(notes)} rows that are not stations are left out: {quoted}"
    return kept, (Remark(RemarkKind.ROWS_LEFT_OUT, text, {"rows": float(len(notes))}),)


def refuse_surplus_numbers(rows: Sequence[Row], width: int) -> None:
    """Raise ListFileError if a row has numbers beyond its first `width` cells: the names do not match the row."""
    for row in rows:
        if any(number_cells.looks_like_number(cell) for cell in row.cells[width:]):
            raise ListFileError(
                f"{row.at}: {len(row.cells)} cells under {width} names: decimal or thousands marks split columns, "
                "or a name is missing; write the list with semicolons or tabs between columns, or name each column"
            )


def _is_sentence(row: Row, above: Row, depth: int) -> bool:
    """
    Return whether a row that begins with a number is a sentence below the list, such as "12 stations".

    Such a row has words after the number, and the number is not deeper than the row above.
    """
    words = [str(cell) for cell in row.cells if str(cell).strip() and not number_cells.is_null(cell)]
    if len(words) < 2 or not any(any(c.isalpha() for c in word) for word in words[1:]):
        return False
    here, before = (_roughly(one.cells[depth]) for one in (row, above))
    return not here > before


def _roughly(cell: number_cells.Cell) -> float:
    """Return the number in a cell, with the decimal mark inferred from this cell only; nan without a number."""
    found = number_cells.split(cell)
    try:
        return math.nan if found is None else number_cells.value(found[0], number_cells.decimal_mark(found[0]))
    except ValueError:
        return math.nan
