# SPDX-License-Identifier: Apache-2.0
"""
Read files that other people wrote: regular files within a budget (`budgets`), JSON, and YAML within a size limit.

Reading a device or pipe in place of a file may never end. A few lines of YAML whose aliases refer to each other can
expand to more than the memory holds. Deep nesting exhausts the stack of a parser.
"""

from __future__ import annotations

import errno
import itertools
import json
import os
import re
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import MB, Budget, BudgetError
from mwd_sensors.core.settings import SettingsError

_PIECE = 1_000_000  # bytes that are read or counted at a time
# Largest number of characters of a number in YAML: Python needs quadratic time for the conversion of long numbers.
_LONGEST_NUMBER = 100
_NUMBER = re.compile(r"[-+0-9._:xXoObBa-fA-F]+")
_LONGEST_LINE = 20_000  # largest number of characters of a line in a table
# Largest number of YAML directives (%TAG). The files of this project need none, and the parser compares each directive
# with all before it.
_MOST_DIRECTIVES = 100
_DIRECTIVE = re.compile(r"^%", re.MULTILINE)


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """YAML loader for plain types. An impossible date stays text, so that the settings check can name its key."""


def _timestamp(loader: Any, node: Any) -> Any:
    try:
        return loader.construct_yaml_timestamp(node)
    except ValueError:
        return node.value


_Loader.add_constructor("tag:yaml.org,2002:timestamp", _timestamp)


def open_regular(path: Path | str) -> int:
    """
    Open a regular file for reading and return its descriptor.

    Raises
    ------
    OSError
        The file cannot be opened or is not a regular file (a folder, device or pipe); `strerror` has the reason.
    """
    # Non-blocking, because opening a pipe would wait for its writer.
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if stat.S_ISREG(os.fstat(handle).st_mode):
        return handle
    os.close(handle)
    raise OSError(errno.EINVAL, "is not a regular file", str(path))


def check_regular(path: Path | str, budget: Budget) -> int:
    """
    Check the size of a file that a library will open against its budget, and return the size in bytes.

    Raises
    ------
    OSError
        The file cannot be opened, is not a regular file, or is larger than the budget; `strerror` has the reason.
    """
    handle = open_regular(path)
    try:
        size = os.fstat(handle).st_size
    finally:
        os.close(handle)
    if size > budget.size:
        raise _too_large(path, budget)
    return size


def _too_large(path: Path | str, budget: Budget) -> OSError:
    return OSError(errno.EFBIG, f"is larger than {budget.size / MB:g} MB", str(path))


def read_file(path: Path | str, budget: Budget) -> bytes:
    """
    Read the bytes of a regular file.

    Raises
    ------
    OSError
        The file cannot be opened, is not a regular file (a folder, device or pipe), or is larger than the budget;
        `strerror` has the reason.
    """
    with os.fdopen(open_regular(path), "rb") as file:
        # Read in pieces: one read of the largest allowed size would allocate that much memory even for a short file.
        pieces, size = [], 0
        while size <= budget.size and (piece := file.read(_PIECE)):
            pieces.append(piece)
            size += len(piece)
    if size > budget.size:
        raise _too_large(path, budget)
    return b"".join(pieces)


def read_text(path: Path | str, budget: Budget) -> str:
    """
    Read the text of a regular file, UTF-8 with or without byte order mark. OSError as for `read_file`.

    Raises
    ------
    SettingsError
        The file is not UTF-8; the message names the file.
    """
    try:
        return read_file(path, budget).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path} is not UTF-8 text (byte {error.start}): save it as UTF-8") from error


def check_lines(text: str, budget: Budget) -> None:
    """
    Check a text with one record per line against its budget, before a parser spends more time on it.

    Raises
    ------
    BudgetError
        The text has more lines than the allowed records, or a line has too many fields or characters.
    """
    # Count the lines as `str.splitlines` divides them, without creating the lines.
    ends = itertools.islice(_LINE_END.finditer(text), budget.records)
    budget.check("records", sum(1 for _ in ends) + 1)
    if budget.columns is None or len(text) <= budget.columns:
        return
    for number, line in enumerate(text.splitlines(), start=1):
        if len(line) > budget.columns:
            if len(line) > _LONGEST_LINE:
                raise BudgetError(f"line {number} has {len(line)} characters: at most {_LONGEST_LINE} are read")
            budget.check("columns", len(_FIELD.findall(line)))


_FIELD = re.compile(r"[^\s,;]+|[,;]")
_LINE_END = re.compile("\r\n|[\n\r\v\f\x1c-\x1e\x85\u2028\u2029]")


def read_yaml(path: Path) -> Any:
    """
    Read a YAML file of plain types. OSError as for `read_file`.

    Raises
    ------
    SettingsError
        The file is not UTF-8 or is refused by `load_yaml`; the message names the file.
    """
    try:
        return load_yaml(read_text(path, budgets.YAML))
    except yaml.YAMLError as error:
        raise SettingsError(f"{path} is not YAML: {str(error).splitlines()[0]}") from error


def load_json(
    text: str | bytes, budget: Budget = budgets.JSON, parse_constant: Callable[[str], Any] | None = None
) -> Any:
    """
    Return the value of a JSON text; parse_constant is passed on to `json.loads`.

    Raises
    ------
    ValueError
        The text is not JSON, or is longer or nested more deeply than the budget allows.
    """
    data = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text
    budget.check("size", len(data))
    if budget.nesting is not None and _brackets(data) > budget.nesting:
        # `_brackets` also counts brackets inside strings. Only if the count is above the limit, count again without the
        # strings, which takes longer.
        budget.check("nesting", _brackets(_TEXT.sub(b"", data)))
    try:
        return json.loads(text, parse_constant=parse_constant)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


_TEXT = re.compile(rb'"(?:[^"\\]|\\.)*"', re.DOTALL)


def _brackets(data: bytes) -> int:
    """Return the largest depth of nested brackets in JSON; brackets inside strings count too."""
    level = deepest = 0
    for begin in range(0, len(data), _PIECE):
        # The codes of [ and { differ in one bit, as do those of ] and }.
        codes = np.frombuffer(data[begin : begin + _PIECE], dtype=np.uint8) | 0x20
        levels = level + np.cumsum((codes == ord("{")).astype(np.int64) - (codes == ord("}")))
        level, deepest = int(levels[-1]), max(deepest, int(levels.max()))
    return deepest


def load_yaml(text: str) -> Any:
    """
    Return the value of a YAML text of plain types.

    Raises
    ------
    yaml.YAMLError
        The text is not YAML, has tags of other types, is nested too deeply, gives a key twice, expands (aliases, merged
        tables) to more than the budget, has a number that is too long, or has more than `_MOST_DIRECTIVES` directives.
    """
    _check_yaml(text)
    try:
        return yaml.load(text, _Loader)  # noqa: S506  (safe, and in C where built)
    except (ValueError, OverflowError) as error:
        # A tag such as !!int requests a conversion, which fails if the text is not a number.
        raise yaml.YAMLError("a value does not fit its notation or tag") from error


class _Keys:
    """Keys of the open tables of a YAML text. The YAML library would silently use the last value of a repeated key."""

    def __init__(self) -> None:
        # For each open collection: the keys so far (None for a list), and whether the next value is a key.
        self._open: list[tuple[set[str] | None, bool]] = []

    def take(self, event: Any) -> None:
        """
        Process one event of the YAML parser.

        Raises
        ------
        yaml.YAMLError
            A key occurs twice in one table.
        """
        if isinstance(event, yaml.CollectionEndEvent):
            self._open.pop()
            return
        if not isinstance(event, yaml.NodeEvent):
            return
        if self._open:
            keys, is_key = self._open[-1]
            self._open[-1] = keys, not is_key
            if keys is not None and is_key and isinstance(event, yaml.ScalarEvent) and event.value != "<<":
                if event.value in keys:
                    raise yaml.YAMLError(f"line {event.start_mark.line + 1}: a key occurs twice in one table")
                keys.add(event.value)
        if isinstance(event, yaml.CollectionStartEvent):
            self._open.append((set() if isinstance(event, yaml.MappingStartEvent) else None, True))


def _check_yaml(text: str) -> None:
    """
    Check a YAML text before any value is created; values are counted as if every alias were written out.

    The parser's events arrive without recursion and in the order of the text. Checking the result would be too late: an
    alias of a merged table (``<<``) is expanded while the table is built.

    Raises yaml.YAMLError if the text is not YAML, or breaks one of the limits named in `load_yaml`.
    """
    directives = itertools.islice(_DIRECTIVE.finditer(text), _MOST_DIRECTIVES + 1)
    if len(list(directives)) > _MOST_DIRECTIVES:
        raise yaml.YAMLError(f"has more than {_MOST_DIRECTIVES} lines that begin with %")
    budget = budgets.YAML
    sizes: dict[str, int] = {}
    open_: list[tuple[str | None, int]] = []
    total, keys = 0, _Keys()
    for event in yaml.parse(text, _Loader):
        keys.take(event)
        if isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_.pop()
            if anchor is not None:
                sizes[anchor] = total - before
            continue
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise yaml.YAMLError("an alias names a table that contains it or does not exist")
            total += sizes[event.anchor]
        elif isinstance(event, yaml.CollectionStartEvent):
            open_.append((event.anchor, total))
            # An anchor that is defined again no longer refers to its first table.
            sizes.pop(event.anchor, None)
            total += 1
        elif isinstance(event, yaml.ScalarEvent):
            total += 1
            if event.anchor is not None:
                sizes[event.anchor] = 1
            if len(event.value) > _LONGEST_NUMBER and _NUMBER.fullmatch(event.value):
                raise yaml.YAMLError(f"a number has more than {_LONGEST_NUMBER} characters")
        else:
            continue
        try:
            budget.check("nesting", len(open_))
            budget.check("records", total)
        except BudgetError as error:
            raise yaml.YAMLError(str(error)) from error
