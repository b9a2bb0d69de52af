# SPDX-License-Identifier: Apache-2.0
"""Check of an SQLite recording before `rosbags` opens it: its rows must be stored in the file, not computed."""

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
    Refuse a database with views, virtual or computed tables, which yield endless rows from a few hundred bytes.

    Raises
    ------
    OSError
        The path is not a regular file.
    FormatError
        The file is not a database, or one of its tables is not a plain table.
    """
    check_regular(path, budgets.DATABASE)
    try:
        with contextlib.closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True)) as database:
            rows = database.execute("SELECT type, name, sql FROM sqlite_master").fetchmany(1000)
    except sqlite3.Error as error:
        raise FormatError(f"it is not a database that can be read: {error}") from error
    for kind, name, sql in rows:
        if kind == "index" or (kind == "table" and not _COMPUTED & set(str(sql or "").upper().split())):
            continue
        raise FormatError(f"its {kind} {str(name)[:60]!r} is computed; only plain tables are read")
