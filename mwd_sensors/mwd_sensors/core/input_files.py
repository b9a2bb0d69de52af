# SPDX-License-Identifier: Apache-2.0
"""
Files that other people wrote: regular ones of bounded size, JSON, and YAML that stays small when it is unfolded.

A device or a pipe under the name of a file would be read without end; a few lines of YAML whose aliases name each other
unfold to more than a memory holds, and deep nesting exhausts the stack of every reader.
"""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from mwd_sensors.core.settings import SettingsError

LARGEST = 50_000_000  # bytes; a survey list of a million stations is no larger
_PIECE = 1_000_000  # bytes
_DEEPEST = 50
_MOST_NODES = 1_000_000

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_file(path: Path, most: int = LARGEST) -> bytes:
    """
    Read the bytes of a regular file.

    Raises
    ------
    OSError
        It cannot be opened, is no regular file (a folder, device or pipe), or has more than `most` bytes; `strerror`
        says which.
    """
    # Opening a pipe would wait for its writer.
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(handle, "rb") as file:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            raise OSError(errno.EINVAL, "is no regular file", str(path))
        # In pieces: one request for the most that is allowed would take that much memory for a file of a line.
        pieces, size = [], 0
        while size <= most and (piece := file.read(_PIECE)):
            pieces.append(piece)
            size += len(piece)
    if size > most:
        raise OSError(errno.EFBIG, f"is larger than {most / 1e6:g} MB", str(path))
    return b"".join(pieces)


def read_text(path: Path, most: int = LARGEST) -> str:
    """
    Read the text of a regular file, UTF-8 with or without byte order mark. OSError as `read_file`.

    Raises
    ------
    UnicodeDecodeError
        It is not UTF-8.
    """
    return read_file(path, most).decode("utf-8-sig")


def read_yaml(path: Path, most: int = LARGEST) -> Any:
    """
    Read a YAML file of plain types. OSError as `read_file`.

    Raises
    ------
    SettingsError
        It is not UTF-8, or none that `load_yaml` takes; names the file.
    """
    try:
        return load_yaml(read_text(path, most))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path} is not YAML: {str(error).splitlines()[0]}") from error


def load_json(text: str | bytes) -> Any:
    """
    Load JSON.

    Raises
    ------
    ValueError
        It is no JSON, or nested too deeply to be read.
    """
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error


def load_yaml(text: str) -> Any:
    """
    Load YAML of plain types.

    Raises
    ------
    yaml.YAMLError
        It is no YAML, has tags of other types, is nested more than 50 levels deep, or its aliases unfold to more than a
        million values.
    """
    depth = 0
    # Events come without recursion; composing what is nested too deeply would exhaust the stack.
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > _DEEPEST:
            raise yaml.YAMLError(f"nested more than {_DEEPEST} levels deep")
    value = yaml.load(text, _Loader)  # noqa: S506  (safe, and in C where built)
    if _unfolded(value, {}) > _MOST_NODES:
        raise yaml.YAMLError(f"its aliases unfold to more than {_MOST_NODES} values")
    return value


def _unfolded(value: Any, known: dict[int, float]) -> float:
    """How many values there are when each alias is written out; endless for one that contains itself."""
    if not isinstance(value, (Mapping, list, tuple, set)):
        return 1
    if id(value) not in known:
        known[id(value)] = float("inf")
        items = value.values() if isinstance(value, Mapping) else value
        known[id(value)] = 1 + sum(_unfolded(item, known) for item in items)
    return known[id(value)]
