# SPDX-License-Identifier: Apache-2.0
"""
One table layer for every file of rows and named columns: it turns bytes into names, units and rows with their places.

Texts in any usual encoding, with columns separated by tab, semicolon, bar, comma or spaces, and spreadsheets (.xlsx,
Excel 2003 XML, HTML) are recognised by their content, not by the file name. Lines above the column names and comments
are kept as the head. Empty rows, empty columns, ruled lines and column names repeated on every page are ignored.
"""

from __future__ import annotations

import codecs
import collections
import csv
import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import BudgetError
from mwd_sensors.core.input_files import check_lines, read_file
from mwd_surface.list_files.grid_file import (
    Row,
    Sheets,
    archive_sheets,
    html_sheets,
    is_html,
    is_spreadsheet,
    is_spreadsheet_xml,
    xml_sheets,
)
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.number_cells import is_null, looks_like_number, texts
from mwd_surface.list_files.remark import Remark, RemarkKind

_HEAD = 200  # largest number of lines above the line that names the columns
_STACKED = 4  # largest number of lines that together name the columns
_MANY = 6  # number of words of a line that are names of columns, and not a sentence
WIDE, SPACE = "  ", " "  # separators: two or more spaces; any spaces
_SEPARATORS = ("\t", ";", "|", ",", WIDE, SPACE)
_COMMENT = re.compile(r"^\s*(#|!|//|--(?=\s|\w)|\*|%|REM\b|REMARK\b)\s?", re.IGNORECASE)
_RULE = re.compile(r"^[\s\-=_+|*~.:#]*$")
# Cell of a table of spaces: a bearing such as N 45.5 E, a number with its direction, or a word.
_TOKEN = re.compile(r"[NS] ?\d+(?:\.\d+)? ?[EW](?!\S)|[\d.,]*\d [NSEW](?!\S)|\S+")
_BOMS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
# Encodings, tried in this order. A text in one of them contains at least one of the words listed with the encoding.
_ENCODINGS = (
    ("utf-8", ""),
    *((encoding, "глубин|азимут|зенит|давлен|время") for encoding in ("cp1251", "cp866", "koi8-r")),
    ("gb18030", "[深角位距压泵]|时间"),
    ("cp1252", ""),
)

# Share of control characters at the beginning of a file above which the file is not a text: random bytes have 10 %,
# and texts almost none, even if they were recorded from a serial line.
_BINARY, _PROBED = 0.02, 4096
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x19\x1c-\x1f\x7f]")

# Function that returns a score of texts as column names, higher for more likely names; 0 if they are not names.
Header = Callable[[Sequence[str]], int]


@dataclasses.dataclass(frozen=True)
class Table:
    """Table of a file: rows of cells under named columns."""

    name: str  #: name of the file
    at: str  #: place of the column names
    #: `names`, `units`: name and unit of each column; the unit is "" unless the file states it apart from the name
    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[Row, ...]  #: the rows below the names
    head: tuple[str, ...] = ()  #: lines above the names, and comments
    remarks: tuple[Remark, ...] = ()  #: remarks on rows and sheets that were left out
    separator: str = ""  #: text between the cells of a text file, " " or "  " for spaces; "" for other files

    def columns(self) -> dict[str, list[str]]:
        """Return the columns as text by name, numbers with a decimal point; short rows are padded with empty cells."""
        width = len(self.names)
        cells = [[row.cells[k] if k < len(row.cells) else "" for row in self.rows] for k in range(width)]
        return dict(zip(self.names, texts(cells), strict=True))


def read_bytes(path: Path) -> bytes:
    """
    Return the bytes of a file, if it is not larger than the budget of lists.

    Raises
    ------
    ListFileError
        The file is missing, not a regular file, or too large.
    """
    try:
        return read_file(path, budgets.LIST)
    except OSError as error:
        raise ListFileError(f"{path}: {error.strerror}") from error


def text_of(data: bytes, name: str) -> str:
    """
    Return the text of a file, decoded by its byte order mark, as UTF-8, or in the encoding that fits its bytes.

    Raises
    ------
    ListFileError
        The file is of another kind, such as PDF, an old spreadsheet or a binary file, or has too many lines or columns.
    """
    text = _decoded(data, name)
    if len(_CONTROL.findall(text, 0, _PROBED)) > _BINARY * min(len(text), _PROBED):
        raise ListFileError(f"{name} is not a text but a binary file; give a list as CSV, .xlsx, LAS or WITSML")
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        # Markup may be a single long line; its parser does not read line by line, so the limits do not apply.
        return text
    try:
        check_lines(text, budgets.LIST)
    except BudgetError as error:
        raise ListFileError(f"{name}: {error}") from error
    return text


def _old_office(data: bytes) -> str:
    """Return the kind of a compound file of Microsoft Office, by the names of its streams, and advice to the user."""
    for stream, what in (
        ("Workbook", "an Excel 97 to 2003 workbook (.xls, BIFF8)"),
        ("Book", "an Excel 5 workbook (.xls, BIFF5)"),
        ("WordDocument", "a Word document (.doc)"),
        ("EncryptedPackage", "an .xlsx workbook with a password"),
    ):
        if stream.encode("utf-16-le") in data:
            return f"{what}, which is not read; save the list as .xlsx without a password, or as CSV"
    return "an old document of Microsoft Office; save the list as .xlsx or CSV"


def _decoded(data: bytes, name: str) -> str:
    for magic, what in (
        (b"%PDF", "a PDF; export the list as CSV or .xlsx"),
        (b"\xd0\xcf\x11\xe0", _old_office(data)),
        (b"\x09\x08\x08\x00", "an Excel 5 workbook (.xls, BIFF5), which is not read; save it as .xlsx or CSV"),
        (b"\x09\x04\x06\x00", "an Excel 4 sheet (.xls, BIFF4), which is not read; save it as .xlsx or CSV"),
        (b"\x09\x02\x06\x00", "an Excel 3 sheet (.xls, BIFF3), which is not read; save it as .xlsx or CSV"),
        (b"\x09\x00\x04\x00", "an Excel 2 sheet (.xls, BIFF2), which is not read; save it as .xlsx or CSV"),
        (b"PK\x03\x04", "an archive that is not an .xlsx spreadsheet; save the list as .xlsx or CSV"),
        (b"\x1f\x8b", "packed (gzip); unpack it first"),
    ):
        if data.startswith(magic):
            raise ListFileError(f"{name} is {what}")
    encoding = encoding_of(data)
    if not data.startswith(tuple(mark for mark, _ in _BOMS)):
        return data.decode(encoding, errors="replace")
    try:
        return data.decode(encoding).replace("\x00", "")
    except UnicodeDecodeError as error:
        raise ListFileError(f"{name} begins like {encoding} text, but byte {error.start} is not {encoding}") from error


def encoding_of(data: bytes, *, cut: bool = False) -> str:
    """
    Return the encoding of a text, by its byte order mark, else the first that fits its bytes and its words.

    cut: whether the bytes are only the beginning of a file, and may end inside a character.
    """
    for mark, encoding in _BOMS:
        if data.startswith(mark):
            return encoding
    # UTF-16 text without a byte order mark has a zero in every second byte.
    for encoding, zeros in (("utf-16-le", data[1:200:2]), ("utf-16-be", data[0:200:2])):
        if len(zeros) > 4 and zeros.count(0) > 0.8 * len(zeros):
            return encoding
    for encoding, words in _ENCODINGS:
        try:
            text = codecs.getincrementaldecoder(encoding)().decode(data, final=not cut)
        except UnicodeDecodeError:
            continue
        if re.search(words, text, re.IGNORECASE):
            return encoding
    return "latin-1"


def read_table(path: Path, is_header: Header | None = None, is_unit: Header | None = None) -> Table:
    """
    Return the named columns of a file; is_header, is_unit: see `table_of`.

    Raises
    ------
    ListFileError
        The file cannot be read, is empty, has only names, has a name twice, or has a row with more cells than names.
    """
    table = table_of(read_bytes(path), str(path), is_header, is_unit)
    named = [name for name in table.names if name]
    twice = sorted({name for name in named if named.count(name) > 1})
    if twice:
        raise ListFileError(f"{path}: column {', '.join(twice)} occurs twice")
    if not table.rows:
        raise ListFileError(f"{path} has column names but no row below them")
    for row in table.rows:
        if any(not is_null(cell) for cell in row.cells[len(table.names) :]):
            raise ListFileError(f"{row.at}: {len(row.cells)} cells, but {len(table.names)} columns have names")
    kept = [k for k, name in enumerate(table.names) if name]
    rows = tuple(Row(row.at, tuple(row.cells[k] if k < len(row.cells) else "" for k in kept)) for row in table.rows)
    return dataclasses.replace(table, names=tuple(named), units=tuple(table.units[k] for k in kept), rows=rows)


def table_of(data: bytes, name: str, is_header: Header | None = None, is_unit: Header | None = None) -> Table:
    """
    Return the table in the bytes of a file.

    Parameters
    ----------
    data, name : bytes, str
        The file and its name, for messages.
    is_header : callable, optional
        Returns a score for some texts as column names, 0 if they are not. By default the first line that is not a
        comment has the names.
    is_unit : callable, optional
        Returns a number other than 0 if the cells of the line below the names are units. By default this line is a row.

    Raises
    ------
    ListFileError
        The file is empty or of another kind, or a line cannot be split into cells.
    """
    if is_spreadsheet(data):
        return _of_sheets(archive_sheets(data, name), name, is_header, is_unit)
    text = text_of(data, name)
    if is_spreadsheet_xml(text):
        return _of_sheets(xml_sheets(text, name), name, is_header, is_unit)
    if is_html(text):
        return _of_sheets(html_sheets(text, name), name, is_header, is_unit)
    return _text_table(text, name, is_header, is_unit)


def _of_sheets(grids: Sheets, name: str, is_header: Header | None, is_unit: Header | None) -> Table:
    """
    Return the table of the first sheet with column names; without any, the first row that is not empty has the names.

    Raises ListFileError if all sheets are empty.
    """
    found = []
    for sheet, grid in grids:
        where = _header_in(grid, is_header)
        if where is not None:
            found.append((sheet, grid, where))
    if not found:
        grid = next((grid for _, grid in grids if grid), [])
        if not grid:
            raise ListFileError(f"{name}: empty")
        return _assembled(name, grid, (0, 1), [str(cell) for cell in grid[0].cells], is_unit, ())
    sheet, grid, (first, count) = found[0]
    table = _assembled(name, grid, (first, count), _stacked(grid[first : first + count]), is_unit, ())
    if len(found) > 1:
        others = ", ".join(repr(other) for other, _, _ in found[1:])
        text = f"{name}: sheet {sheet!r} is read; {others} has stations too"
        return dataclasses.replace(table, remarks=(*table.remarks, Remark(RemarkKind.COLUMN_CHOSEN, text)))
    return table


def _text_table(text: str, name: str, is_header: Header | None, is_unit: Header | None) -> Table:
    whole = [(k, line) for k, line in enumerate(text.splitlines(), start=1) if line.strip()]
    marked = [bool(_COMMENT.match(line)) for _, line in whole]
    for at in range(1, len(whole)):
        # The sign # of a column of numbers, in the second line of the names, is not the mark of a comment.
        marked[at] = marked[at] and (marked[at - 1] or not _continues(whole[at - 1][1], whole[at][1]))
    lines = [one for one, comment in zip(whole, marked, strict=True) if not comment]
    comments = [_COMMENT.sub("", line).strip() for (_, line), comment in zip(whole, marked, strict=True) if comment]
    if not lines:
        raise ListFileError(f"{name}: empty")
    if is_header is not None:
        # Column names in a comment count only if no other line has them.
        for candidates in (lines, [(k, _COMMENT.sub("", line)) for k, line in whole]):
            for separator in _SEPARATORS:
                if separator == WIDE:
                    spaced = _spaced(candidates, name, is_header)
                    if spaced is not None:
                        return dataclasses.replace(_assembled(name, *spaced, is_unit, comments), separator=WIDE)
                grid, faults = _parted(candidates, separator, name)
                where = _header_in(grid, is_header)
                if where is not None:
                    for k, fault in faults.items():
                        if k >= sum(where):
                            raise fault
                    names = _stacked(grid[where[0] : sum(where)])
                    table = _assembled(name, grid, where, names, is_unit, comments)
                    return dataclasses.replace(table, separator=separator)
    separator = _most(lines[0][1])
    if separator == SPACE and all(len(line.split()) == 1 for _, line in lines[1:3]):
        # A single column, whose name has several words.
        separator = WIDE
    grid, faults = _parted(lines, separator, name)
    if faults and is_header is None:
        raise next(iter(faults.values()))
    table = _assembled(name, grid, (0, 1), [str(cell) for cell in grid[0].cells], is_unit, comments)
    return dataclasses.replace(table, separator=separator)


def _continues(above: str, line: str) -> bool:
    """Return whether a line has as many words as the line above, as names of columns in several lines have."""
    words, others = line.split(), above.split()
    return len(words) == len(others) >= _MANY and not any(map(looks_like_number, (*words, *others)))


def _parted(lines: Sequence[tuple[int, str]], separator: str, name: str) -> tuple[list[Row], dict[int, ListFileError]]:
    """
    Return the rows of numbered lines, and errors by row number.

    A line that cannot be split becomes a row with one cell, and has an error.
    """
    if separator in (WIDE, SPACE):
        between = re.compile(r"\s{2,}|\t" if separator == WIDE else r"\s+")
        return [Row(f"{name}, line {k}", tuple(between.split(line.strip()))) for k, line in lines], {}
    try:
        return _records(lines, separator, name), {}
    except csv.Error:
        pass
    grid: list[Row] = []
    faults = {}
    for k, line in lines:
        try:
            cells = tuple(cell.strip() for cell in next(csv.reader([line], delimiter=separator, strict=True)))
        except csv.Error as error:
            faults[len(grid)] = ListFileError(f"{name}, line {k}: {error}")
            cells = (line,)
        grid.append(Row(f"{name}, line {k}", cells))
    return grid, faults


def _records(lines: Sequence[tuple[int, str]], separator: str, name: str) -> list[Row]:
    """
    Return the rows of numbered lines; a quoted cell may span a few lines.

    Raises csv.Error if the lines cannot be split this way.
    """
    reader = csv.reader((f"{line}\n" for _, line in lines), delimiter=separator, skipinitialspace=True, strict=True)
    grid, before = [], 0
    for cells in reader:
        if reader.line_num - before > _STACKED * max(1, len(cells)):
            raise csv.Error("a quoted cell has too many lines")
        grid.append(Row(f"{name}, line {lines[before][0]}", tuple(" ".join(cell.split()) for cell in cells)))
        before = reader.line_num
    return grid


def _most(line: str) -> str:
    """Return the separator that occurs most often in a line; spaces if it has none."""
    best = max("\t;|,", key=line.count)
    if line.count(best):
        return best
    return WIDE if WIDE in line.strip() else SPACE


def _header_in(grid: Sequence[Row], is_header: Header | None) -> tuple[int, int] | None:
    """Return the index of the first row of column names and the number of these rows; None without column names."""
    if is_header is None:
        return 0, 1
    for count in range(1, _STACKED + 1):
        for k in range(min(_HEAD, len(grid) - count + 1)):
            rows = grid[k : k + count]
            if any(looks_like_number(cell) for row in rows for cell in row.cells):
                continue
            if count > 1 and any(len(row.cells) < 2 for row in rows):
                continue
            below = grid[k + count : k + count + 12]
            width = max(len(row.cells) for row in rows)
            # Names and rows of a table have about the same number of cells.
            wide = any(2 < len(row.cells) <= width + 2 and sum(map(looks_like_number, row.cells)) > 1 for row in below)
            if (wide or not below) and is_header(_stacked(rows)):
                return _with_above(grid, k, count, is_header)
    return None


def _with_above(grid: Sequence[Row], k: int, count: int, is_header: Header) -> tuple[int, int]:
    """
    Return the index of the first row of column names, and the number of these rows.

    Row k and the `count` - 1 rows below it are names. Rows above them are added if the score of the names then rises.
    """
    best = is_header(_stacked(grid[k : k + count]))
    where = k, count
    for more in range(1, min(k, _STACKED - count) + 1):
        rows = grid[k - more : k + count]
        if any(looks_like_number(cell) for cell in rows[0].cells) or len(rows[0].cells) < 2:
            break
        if any(":" in str(cell) for cell in rows[0].cells):
            break
        score = is_header(_stacked(rows))
        if score > best:
            best, where = score, (k - more, count + more)
    return where


def _stacked(rows: Sequence[Row]) -> list[str]:
    """Return the column names, joined from several header rows column by column."""
    width = max(len(row.cells) for row in rows)
    parts = ([str(row.cells[k]) for row in rows if k < len(row.cells)] for k in range(width))
    return [" ".join(part for part in column if part.strip() and not _RULE.match(part)).strip() for column in parts]


def _spaced(
    lines: Sequence[tuple[int, str]], name: str, is_header: Header
) -> tuple[list[Row], tuple[int, int], list[str]] | None:
    """
    Split rows at spaces; assign each word of the header to the column below it, so that a name may have several words.

    Return the rows, the index of the first header row, the number of header rows, and the names; None if no header is
    found.
    """
    tokens = [list(_TOKEN.finditer(line)) for _, line in lines]
    grid = [
        Row(f"{name}, line {k}", tuple(t.group() for t in found)) for (k, _), found in zip(lines, tokens, strict=True)
    ]
    numeric = [sum(looks_like_number(cell) for cell in row.cells) for row in grid]
    rows = [k for k in range(1, len(grid)) if numeric[k] > 2]
    likely = [k for k in rows if numeric[k] >= len(grid[k].cells) - 1]
    # Rows of data have at most one cell that is not a number. If there are none, accept rows with more such cells, for
    # example a date and a time of day.
    likely = likely or [k for k in rows if 2 * numeric[k] > len(grid[k].cells)]
    if not likely or likely[0] > _HEAD:
        return None
    # Rows that lack a cell are shorter than complete rows.
    counts = collections.Counter(len(grid[k].cells) for k in likely)
    width = max((size for size, rows in counts.items() if rows > 1), default=len(grid[likely[0]].cells))
    full = next(k for k in likely if len(grid[k].cells) == width)
    same = [found for found in tokens[full : full + 30] if len(found) == width]
    spans = [(min(f[j].start() for f in same), max(f[j].end() for f in same)) for j in range(width)]
    grid = [_aligned(row, found, spans) for row, found in zip(grid, tokens, strict=True)]
    # Rows directly above that lack a cell, such as the azimuth of a vertical hole, are data too.
    data = full
    while data > 1 and len(grid[data - 1].cells) == width and 2 * numeric[data - 1] > len(tokens[data - 1]) > 1:
        data -= 1
    # A ruled line with a part for each column shows where the names stand.
    ruled = (
        found for found in tokens[max(0, data - _STACKED - 1) : data] if all(_RULE.match(t.group()) for t in found)
    )
    above = next(([t.span() for t in found] for found in ruled if len(found) == width), spans)
    best: tuple[int, int, list[str]] = (0, 0, [])
    names, parted = [""] * width, [""] * width
    for count in range(1, min(_STACKED + 1, data) + 1):
        line = data - count
        bare = any(looks_like_number(t.group()) and t.group()[-1].isdigit() for t in tokens[line])
        if bare or ":" in lines[line][1] or (count > 1 and lines[line + 1][0] - lines[line][0] > 1):
            # This line holds numbers, other than those of units such as deg/30m, belongs to the head of the list, or
            # follows a gap: it is not part of the names.
            break
        # Read the line in two ways: split at wide spaces, and with each word assigned to the column below it. Join the
        # result with the names from the lines below.
        text = lines[line][1].strip()
        names = [f"{a} {b}".strip() for a, b in zip(_placed_above(tokens[line], above), names, strict=True)]
        wide = re.split(r"\s{2,}|\t", text)
        if len(wide) == width:
            parted = [f"{a} {b}".strip() for a, b in zip(wide, parted, strict=True)]
        for found in (wide, text.split(), parted, names):
            score = is_header(found) if len(found) == width else 0
            if score > best[0]:
                best = score, count, list(found)
    if best[0]:
        return grid, (data - best[1], best[1]), best[2]
    words = [t.group() for t in tokens[data - 1]]
    for grouped in _groupings(words, width):
        if is_header(grouped):
            return grid, (data - 1, 1), grouped
    return None


def _aligned(row: Row, words: Sequence[re.Match[str]], spans: Sequence[tuple[int, int]]) -> Row:
    """Return a row of numbers that lacks cells, with each number in the column at its position; others unchanged."""
    if not 1 < len(words) < len(spans) or not all(looks_like_number(word.group()) for word in words):
        return row
    under = [[k for k, span in enumerate(spans) if min(span[1], w.end()) > max(span[0], w.start())] for w in words]
    if any(len(columns) != 1 for columns in under) or len({columns[0] for columns in under}) < len(words):
        return row
    cells = [""] * len(spans)
    for columns, word in zip(under, words, strict=True):
        cells[columns[0]] = word.group()
    return Row(row.at, tuple(cells))


def _placed_above(words: Sequence[re.Match[str]], spans: Sequence[tuple[int, int]]) -> list[str]:
    """Return the words of a line, each assigned to the column that it stands above."""
    names = [""] * len(spans)
    for word in words:
        if not _RULE.match(word.group()):
            apart = [_apart(span, word.span()) for span in spans]
            near = apart.index(min(apart))
            names[near] = f"{names[near]} {word.group()}".strip()
    return names


def _apart(span: tuple[int, int], word: tuple[int, int]) -> float:
    """Return the distance between the centres of a column and a word, characters; plus 1000 if they do not overlap."""
    overlap = min(span[1], word[1]) - max(span[0], word[0])
    return (0.0 if overlap > 0 else 1000.0) + abs(span[0] + span[1] - word[0] - word[1]) / 2.0


def _groupings(words: Sequence[str], width: int) -> Iterator[list[str]]:
    """Yield each split of words into `width` names of one to four words, until 20 000 steps of the search are done."""
    most = 20_000
    stack: list[tuple[int, list[str]]] = [(0, [])]
    while stack and most:
        most -= 1
        k, names = stack.pop()
        if len(names) == width:
            if k == len(words):
                yield names
            continue
        room = len(words) - k - (width - len(names) - 1)
        stack += [(k + size, [*names, " ".join(words[k : k + size])]) for size in (4, 3, 2, 1) if size <= room]


def _assembled(
    name: str,
    grid: Sequence[Row],
    where: tuple[int, int],
    names: Sequence[str],
    is_unit: Header | None,
    comments: Sequence[str],
) -> Table:
    """Return the table below its names, without repeated names, ruled lines and empty rows; where: see `_header_in`."""
    first, count = where
    head = [*comments, *(" ".join(str(c) for c in row.cells if str(c)) for row in grid[:first])]
    above = {_plain(row) for row in grid[first : first + count]} | {_plain(row) for row in grid[:first]}
    rows: list[Row] = []
    left_out: list[Row] = []
    units: tuple[str, ...] = ("",) * len(names)
    for row in grid[first + count :]:
        if all(_RULE.match(str(cell)) for cell in row.cells):
            # Skip an empty row or a ruled line.
            continue
        if not rows and is_unit is not None and is_unit([str(cell) for cell in row.cells]):
            # A line of units; a second such line may give datum and north.
            more = tuple(str(cell) for cell in row.cells[: len(names)]) + ("",) * (len(names) - len(row.cells))
            units = tuple(f"{unit} {word}".strip() for unit, word in zip(units, more, strict=True))
            above.add(_plain(row))
        elif _plain(row) in above:
            left_out.append(row)
        else:
            rows.append(row)
    remarks: tuple[Remark, ...] = ()
    if left_out:
        text = f"{name}: {len(left_out)} rows that repeat the head of the table are left out, first at {left_out[0].at}"
        remarks = (Remark(RemarkKind.ROWS_LEFT_OUT, text, {"rows": float(len(left_out))}),)
    return Table(name, grid[first].at, tuple(names), units, tuple(rows), tuple(head), remarks)


def _plain(row: Row) -> tuple[str, ...]:
    cells = [str(cell).strip().lower() for cell in row.cells]
    while cells and not cells[-1]:
        cells.pop()
    return tuple(cells)
