# SPDX-License-Identifier: Apache-2.0
"""
Cells of a table as numbers: decimal and thousands marks judged over a whole column, null values, units in a cell.

The decimal mark is found from all cells of the column, else from the other columns, else from the plausible range of
the quantity. If none of them decides, the reader asks; it never guesses between 1 m and 1000 m.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

Cell = str | float


def words_of(text: str) -> frozenset[str]:
    """Return the words of a list that are separated by bars."""
    return frozenset(text.split("|"))


# Numbers that programs write to mean "no value" (LAS, Petrel, WITSML, spreadsheets).
NULL_NUMBERS = (-999.25, -999.0, -9999.0, -9999.25, -99999.0, -999.99, -9999.99, 1e30, -1e30, 1.0e33)
_NULL_WORDS = words_of(
    "-|--|---|.|na|n/a|n.a.|n.a|nan|nil|null|none|void|?|#n/a|#na|#value!|#ref!|#div/0!|#num!|#null!|absent|(null)|"
    "<null>|inf|+inf|-inf|无|空"
)
_MINUS = str.maketrans({"\u2212": "-", "\u2013": "-", "\ufe63": "-", "\uff0d": "-", "\uff0e": ".", "\uff0c": ","})
_NUMBER = re.compile(
    r"""^(?P<number>[+-]?\s?(?:\d[\d.,'’\u00a0\u202f\u2009 ]*|[.,]\d+)(?:[eEdD][+-]?\d+)?)\s*(?P<rest>\D*)$""",
    re.DOTALL,
)
_SPACES = re.compile("(?<=\\d)['’\u00a0\u202f\u2009 ](?=\\d{3}(?!\\d))")
_FORMULA = re.compile(r'^="(.*)"$')
_LONGEST = 100  # longest text read as a number with unit, characters; matching time grows with the square of the length
_GROUPED = re.compile(r"^[+-]?[1-9]\d{0,2}(?P<mark>[.,])\d{3}$")


_QUADRANT = re.compile(r"^(?P<pole>[NS])\s*(?P<angle>\d[^EW]*?)\s*(?:deg)?\s*(?P<side>[EW])$", re.IGNORECASE)
_SEXAGESIMAL = re.compile(
    r"""^(?P<sign>[+-]?)(?P<degrees>\d{1,3})\s*[°ºd\s]\s*(?P<minutes>\d{1,2}(?:[.,]\d+)?)\s*"""
    r"""(?:['′’m\s]\s*(?:(?P<seconds>\d{1,2}(?:[.,]\d+)?)\s*(?:"|″|”|''|s)?)?)?$"""
)


def is_null(cell: Cell) -> bool:
    """Return whether a cell is empty or holds one of the usual marks for a missing value."""
    if isinstance(cell, float):
        return not math.isfinite(cell) or cell in NULL_NUMBERS
    text = cell.strip().lower()
    return not text or text in _NULL_WORDS or _plain_null(text)


def _plain_null(text: str) -> bool:
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        return False
    return not math.isfinite(value) or value in NULL_NUMBERS


def split(cell: Cell) -> tuple[str, str] | None:
    """Return the number in a cell, without group spaces, and the words after it; None if the cell is not a number."""
    if isinstance(cell, float):
        return repr(cell), ""
    # Programs write ="12.5" so that a spreadsheet keeps the text of a number.
    text = _FORMULA.sub(r"\1", cell.strip()).translate(_MINUS)
    if len(text) > _LONGEST:
        return None
    # Spreadsheets put an apostrophe in front of a number that is stored as text.
    found = _NUMBER.match(text[1:] if text[:1] in "'’" else text)
    if found is None:
        return None
    number = _SPACES.sub("", found["number"].strip())
    number = number[:1] + number[1:].lstrip() if number[:1] in "+-" else number
    if any(c.isspace() for c in number):
        # Two numbers, such as degrees and minutes.
        return None
    return number.rstrip(".,") if number[-1:] in ".," else number, found["rest"].strip()


def looks_like_number(cell: Cell) -> bool:
    """
    Return whether a cell holds a number with a decimal point or comma, and at most 12 characters after the number.

    A null value is not a number.
    """
    if is_null(cell):
        return False
    found = split(cell)
    if found is None or len(found[1]) > 12:
        return False
    try:
        return math.isfinite(value(found[0], decimal_mark(found[0])))
    except ValueError:
        return False


def decimal_mark(number: str) -> str:
    """Return the decimal mark, "." or ",", if this number alone reveals it; else ""."""
    points, commas = number.count("."), number.count(",")
    if points and commas:
        last = max(".,", key=number.rfind)
        return last if number.count(last) == 1 else ""
    if points + commas != 1:
        # A mark that occurs more than once separates thousands, so the other mark is the decimal mark.
        return "," if points > 1 else "." if commas > 1 else ""
    if _GROUPED.match(number):
        return ""
    return "." if points else ","


def marks(cells: Iterable[Cell]) -> set[str]:
    """Return the decimal marks that the numbers of a column reveal."""
    found = (split(cell) for cell in cells if not is_null(cell))
    return {decimal_mark(one[0]) for one in found if one is not None} - {""}


def ambiguous(cells: Iterable[Cell]) -> list[str]:
    """Return the numbers of a column, such as "1,000", whose two readings differ by a factor of a thousand."""
    found = (split(cell) for cell in cells if not isinstance(cell, float) and not is_null(cell))
    return [one[0] for one in found if one is not None and _GROUPED.match(one[0])]


def value(number: str, mark: str) -> float:
    """
    Return a number read with a decimal mark, "." or ","; an empty mark means that the number has no decimals.

    Raises
    ------
    ValueError
        The text is not a number with that decimal mark.
    """
    other = {",": ".", ".": ",", "": ","}[mark]
    whole, decimal, rest = number.partition(mark) if mark else (number, "", "")
    if other in rest:
        raise ValueError(f"{number!r} is not a number with the decimal mark {mark!r}")
    if other in whole:
        groups = re.split(r"[.,]", whole.lstrip("+-"))
        if not 1 <= len(groups[0]) <= 3 or any(len(group) != 3 for group in groups[1:]):
            raise ValueError(f"{number!r} has a thousands mark that does not separate groups of three digits")
        whole = whole.replace(other, "")
    return float(f"{whole}{'.' if decimal else ''}{rest}".replace("d", "e").replace("D", "e"))


def angle(text: str, *, bearing: bool) -> float:
    """
    Return an angle in deg from degrees, minutes and seconds or from a quadrant bearing; nan for other texts.

    Marks of degrees, minutes and seconds may be spaces, as in "212 30.5".

    bearing: accept quadrant bearings such as "N 45.5 E" and "S45°30'W", which are clockwise from north.
    """
    found = _QUADRANT.match(text.strip()) if bearing else None
    if found is None:
        return _sexagesimal(text)
    whole = found["angle"].replace(",", ".").strip().rstrip("°")
    try:
        within = float(whole)
    except ValueError:
        within = _sexagesimal(whole)
    if not 0.0 <= within <= 90.0:
        return math.nan
    east = within if found["side"].upper() == "E" else -within
    return (east if found["pole"].upper() == "N" else 180.0 - east) % 360.0


def _sexagesimal(text: str) -> float:
    found = _SEXAGESIMAL.match(text.strip())
    if found is None:
        return math.nan
    minutes, seconds = (float((found[part] or "0").replace(",", ".")) for part in ("minutes", "seconds"))
    if minutes >= 60.0 or seconds >= 60.0:
        return math.nan
    size = float(found["degrees"]) + minutes / 60.0 + seconds / 3600.0
    return -size if found["sign"] == "-" else size


def texts(columns: Sequence[Sequence[Cell]]) -> list[list[str]]:
    """
    Return columns as text: numbers with a decimal point, null values as empty text, other cells as they are.

    If no cell reveals the decimal mark, the point is the decimal mark.
    """
    shown = set().union(*(marks(cells) for cells in columns)) if columns else set()
    whole = next(iter(shown)) if len(shown) == 1 else "."
    done = []
    for cells in columns:
        own = marks(cells)
        mark = next(iter(own)) if len(own) == 1 else whole
        done.append(["" if is_null(cell) else _canonical(cell, mark) for cell in cells])
    return done


def _canonical(cell: Cell, mark: str) -> str:
    """Return a cell as text, a number with a decimal point."""
    if isinstance(cell, float):
        return repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    found = split(cell)
    try:
        if found is not None and (mark == "," or "," in found[0]):
            return f"{value(found[0], mark)!r} {found[1]}".strip()
    except ValueError:
        # Words that begin like a number.
        pass
    return cell.strip() if found is None or found[1] else found[0]
