# SPDX-License-Identifier: Apache-2.0
"""Looks at an SQLite recording before `rosbags` opens it: its rows must lie in the file, not be computed from it."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path
from urllib.parse import quote

from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import check_regular
from mwd_surface.bags.mcap.records import FormatError

_COMPUTED = {"VIRTUAL", "GENERATED", "AS"}


def check_database(path: Path) -> None:
    """
    Refuse a database whose tables are views, virtual or computed: a few hundred bytes of them make rows without end.

    Raises
    ------
    OSError
        It is not a regular file.
    FormatError
        It is no database, or one of its tables is not a plain one.
    """
    check_regular(path, budgets.DATABASE)
    try:
        with contextlib.closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True)) as database:
            rows = database.execute("SELECT type, name, sql FROM sqlite_master").fetchmany(1000)
    except sqlite3.Error as error:
        raise FormatError(f"it is no database that can be read: {error}") from error
    for kind, name, sql in rows:
        if kind == "index" or (kind == "table" and not _COMPUTED & set(str(sql or "").upper().split())):
            continue
        raise FormatError(f"its {kind} {str(name)[:60]!r} is computed; only plain tables are read")
