# SPDX-License-Identifier: Apache-2.0
"""
Files that other people wrote: regular ones within a budget (`budgets`), JSON, and YAML that stays small when unfolded.

A device or a pipe under the name of a file would be read without end; a few lines of YAML whose aliases name each other
unfold to more than a memory holds, and deep nesting exhausts the stack of every reader.
"""

from __future__ import annotations

import errno
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

_PIECE = 1_000_000  # bytes
# The longest plain scalar that YAML may read as a number: Python converts longer ones in quadratic time.
_LONGEST_NUMBER = 100
_NUMBER = re.compile(r"[-+0-9._:xXoObBa-fA-F]+")
_LONGEST_LINE = 20_000  # characters


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Plain types; a date that does not exist stays text, so that the settings name its key."""


def _timestamp(loader: Any, node: Any) -> Any:
    try:
        return loader.construct_yaml_timestamp(node)
    except ValueError:
        return node.value


_Loader.add_constructor("tag:yaml.org,2002:timestamp", _timestamp)


def open_regular(path: Path | str) -> int:
    """
    Open a regular file for reading; returns its descriptor.

    Raises
    ------
    OSError
        It cannot be opened, or is no regular file (a folder, device or pipe); `strerror` says which.
    """
    # Opening a pipe would wait for its writer.
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if stat.S_ISREG(os.fstat(handle).st_mode):
        return handle
    os.close(handle)
    raise OSError(errno.EINVAL, "is no regular file", str(path))


def check_regular(path: Path | str, budget: Budget) -> int:
    """
    Hold a file that a library will open against its budget; returns its size in bytes.

    Raises
    ------
    OSError
        As `read_file`.
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
        It cannot be opened, is no regular file (a folder, device or pipe), or is larger than the budget; `strerror`
        says which.
    """
    with os.fdopen(open_regular(path), "rb") as file:
        # In pieces: one request for the most that is allowed would take that much memory for a file of a line.
        pieces, size = [], 0
        while size <= budget.size and (piece := file.read(_PIECE)):
            pieces.append(piece)
            size += len(piece)
    if size > budget.size:
        raise _too_large(path, budget)
    return b"".join(pieces)


def read_text(path: Path | str, budget: Budget) -> str:
    """
    Read the text of a regular file, UTF-8 with or without byte order mark. OSError as `read_file`.

    Raises
    ------
    SettingsError
        It is not UTF-8; names the file.
    """
    try:
        return read_file(path, budget).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path} is no UTF-8 text (byte {error.start}): save it as UTF-8") from error


def check_lines(text: str, budget: Budget) -> None:
    """
    Hold a text whose lines are records against its budget, before a parser counts columns at a cost beyond their sum.

    Raises
    ------
    BudgetError
        It has more lines than records are allowed, or a line with more fields or characters.
    """
    budget.check("records", text.count("\n") + 1)
    if budget.columns is None or len(text) <= budget.columns:
        return
    for number, line in enumerate(text.splitlines(), start=1):
        if len(line) > budget.columns:
            if len(line) > _LONGEST_LINE:
                raise BudgetError(f"line {number} has {len(line)} characters: at most {_LONGEST_LINE} are read")
            budget.check("columns", len(_FIELD.findall(line)))


_FIELD = re.compile(r"[^\s,;]+|[,;]")


def read_yaml(path: Path) -> Any:
    """
    Read a YAML file of plain types. OSError as `read_file`.

    Raises
    ------
    SettingsError
        It is not UTF-8, or none that `load_yaml` takes; names the file.
    """
    try:
        return load_yaml(read_text(path, budgets.YAML))
    except yaml.YAMLError as error:
        raise SettingsError(f"{path} is not YAML: {str(error).splitlines()[0]}") from error


def load_json(
    text: str | bytes, budget: Budget = budgets.JSON, parse_constant: Callable[[str], Any] | None = None
) -> Any:
    """
    Load JSON; parse_constant: as `json.loads`.

    Raises
    ------
    ValueError
        It is no JSON, or nested more deeply than the budget allows.
    """
    data = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text
    budget.check("size", len(data))
    if budget.nesting is not None and _brackets(data) > budget.nesting:
        # Brackets in texts count only where there are many of all.
        budget.check("nesting", _brackets(_TEXT.sub(b"", data)))
    try:
        return json.loads(text, parse_constant=parse_constant)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


_TEXT = re.compile(rb'"(?:[^"\\]|\\.)*"', re.DOTALL)


def _brackets(data: bytes) -> int:
    """Return the deepest level of brackets."""
    level = deepest = 0
    for begin in range(0, len(data), _PIECE):
        # [ and {, and ] and }, differ in one bit.
        codes = np.frombuffer(data[begin : begin + _PIECE], dtype=np.uint8) | 0x20
        levels = level + np.cumsum((codes == ord("{")).astype(np.int64) - (codes == ord("}")))
        level, deepest = int(levels[-1]), max(deepest, int(levels.max()))
    return deepest


def load_yaml(text: str) -> Any:
    """
    Load YAML of plain types.

    Raises
    ------
    yaml.YAMLError
        It is no YAML, has tags of other types, is nested too deeply, gives a key twice, its aliases and merged tables
        unfold to more than the budget, or one of its numbers is too long.
    """
    _check_yaml(text)
    try:
        return yaml.load(text, _Loader)  # noqa: S506  (safe, and in C where built)
    except (ValueError, OverflowError) as error:
        # Of a number that Python refuses; a tag may ask for one anywhere.
        raise yaml.YAMLError("a value is not what its form or tag says") from error


class _Keys:
    """Keys of the tables that are open: one that comes twice would count with its last value, and nobody be told."""

    def __init__(self) -> None:
        # Of each open collection the keys so far (None: a list), and whether a key comes next.
        self._open: list[tuple[set[str] | None, bool]] = []

    def take(self, event: Any) -> None:
        """
        Follow one event of the text.

        Raises
        ------
        yaml.YAMLError
            A key of this table has come before.
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
                    raise yaml.YAMLError(f"line {event.start_mark.line + 1}: a key stands twice in one table")
                keys.add(event.value)
        if isinstance(event, yaml.CollectionStartEvent):
            self._open.append((set() if isinstance(event, yaml.MappingStartEvent) else None, True))


def _check_yaml(text: str) -> None:
    """
    Count the values of a YAML text as if each alias was written out, before any of them is made.

    Events come without recursion and in the order of the text: an alias of a table that is merged (``<<``) is written
    out while the table is composed, where no check of the result could come in time.
    """
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
            # An anchor that is given again means its first table no more.
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
