# SPDX-License-Identifier: Apache-2.0
"""
Reading the ``.db3`` files of a bag (sqlite3 storage) through `rosbags`, merged by time.

If the recorder was not closed, the last messages of a file are in a write-ahead log, or its last consistent state in a
journal, in the same folder. Such a file is completed in a temporary copy, so that the user's files stay unchanged and
read-only media can be read.
"""

from __future__ import annotations

import contextlib
import heapq
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import quote

from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import check_regular
from mwd_surface.bags.mcap.records import FormatError
from mwd_surface.bags.topic_info import CDR, TopicInfo, read_as

_LOGS = ("-wal", "-journal")
_SCHEMAS = {MessageDefinitionFormat.MSG: "ros2msg", MessageDefinitionFormat.IDL: "ros2idl"}


class DatabaseFiles:
    """
    Opened ``.db3`` files.

    Parameters
    ----------
    files : list of Path
    scratch : callable
        Returns a temporary folder that exists as long as the bag is open.

    Attributes
    ----------
    topics, unreadable, start_ns, end_ns, notes, complete
        See `ros1_bag.Ros1Bag`; `complete` is false if one of several files cannot be read.

    Raises
    ------
    ReaderError
        No file can be read.
    """

    def __init__(self, files: list[Path], scratch: Callable[[], Path]) -> None:
        self.topics: dict[str, TopicInfo] = {}
        self.unreadable: dict[str, TopicInfo] = {}
        self.notes = [".db3 storage: read through rosbags, which is slower"]
        self.complete = True
        self._readers: list[Sqlite3Reader] = []
        problems: list[str] = []
        try:
            for number, path in enumerate(files):
                try:
                    complete = self._completed(path, number, scratch)
                    check_database(complete)
                    reader = Sqlite3Reader(complete)
                    reader.open()
                except (FormatError, ReaderError, sqlite3.Error, KeyError, TypeError, ValueError) as error:
                    problems.append(f"{path.name}: {error}")
                    continue
                self._readers.append(reader)
                self._join_topics(reader)
        except BaseException:
            self.close()
            raise
        if problems and not self._readers:
            raise ReaderError("; ".join(problems))
        self.notes += [f"{problem}; skipped" for problem in problems]
        self.complete = not problems
        filled = [reader.metadata for reader in self._readers if reader.metadata.message_count]
        self.start_ns = min((one.start_time for one in filled), default=0)
        self.end_ns = max((one.end_time - 1 for one in filled), default=0)

    def messages(self, topics: list[str], start: int | None, stop: int | None) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, log time in ns, and bytes of each message, in time order over all files."""

        def of(reader: Sqlite3Reader) -> Iterator[tuple[str, int, bytes]]:
            chosen = [
                one for one in reader.connections if one.topic in topics and self._is_read(one.topic, one.msgtype)
            ]
            for connection, log_ns, data in reader.messages(chosen, start, stop) if chosen else ():
                yield connection.topic, log_ns, data

        return heapq.merge(*map(of, self._readers), key=lambda row: row[1])

    def close(self) -> None:
        """Close the files."""
        for reader in self._readers:
            if reader.dbconn is not None:
                reader.close()
        self._readers = []

    def _completed(self, path: Path, number: int, scratch: Callable[[], Path]) -> Path:
        """Return the file, or a copy of it that includes the messages of its log."""
        logs = [path.with_name(path.name + suffix) for suffix in _LOGS]
        logs = [log for log in logs if log.is_file() and log.stat().st_size]
        if not logs:
            return path
        copy = scratch() / f"{number}.db3"
        for source in (path, *logs):
            shutil.copyfile(source, copy.with_name(copy.name + source.name.removeprefix(path.name)))
        connection = sqlite3.connect(copy)
        try:
            # Opening the copy rolls a journal back; the checkpoint moves the messages of the log into the file.
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            connection.execute("PRAGMA journal_mode=DELETE")
        finally:
            connection.close()
        names = ", ".join(log.name for log in logs)
        self.notes.append(
            f"{path.name} was not closed by its recorder: read together with {names}, in a temporary copy"
        )
        return copy

    def _join_topics(self, reader: Sqlite3Reader) -> None:
        for one in reader.connections:
            format_name = getattr(one.ext, "serialization_format", CDR)
            type_name, _, problem = read_as(format_name, "", one.msgtype)
            there = self.unreadable if problem else self.topics
            known = there.get(one.topic)
            if known is not None and known.type_name != type_name:
                self.notes.append(
                    f"{one.topic} has messages of {known.type_name} and of {type_name}; the latter are left out"
                )
                continue
            there[one.topic] = TopicInfo(
                one.topic,
                type_name,
                one.msgcount + (known.count if known else 0),
                _SCHEMAS.get(one.msgdef.format, ""),
                one.msgdef.data,
                one.digest,
                "",
                format_name,
                problem,
            )

    def _is_read(self, topic: str, type_name: str) -> bool:
        about = self.topics.get(topic) or self.unreadable.get(topic)
        return about is not None and about.type_name == type_name


# Check of an SQLite recording before `rosbags` opens it: its rows must be stored in the file, not computed.


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
