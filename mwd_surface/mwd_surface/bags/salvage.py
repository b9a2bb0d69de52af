# SPDX-License-Identifier: Apache-2.0
"""
Recovery of recordings that are not MCAP: a ROS 1 bag that was cut, a database that was not closed.

All messages that can be read are written to a new bag of MCAP storage; the recording is not changed.
"""

from __future__ import annotations

import itertools
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from pathlib import Path

from mwd_surface.bags.bag_files import BagError, files_of, storage_of
from mwd_surface.bags.bag_metadata import FILE_NAME
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.mcap import recovery
from mwd_surface.bags.mcap.recovery import RecoveryReport
from mwd_surface.bags.topic_info import TopicInfo

# Rows read from a damaged database at once; number of consecutive empty reads that end the search.
_STEP, _BARREN = 1000, 50
# Largest ratio of the size stated in the header of a database to the size of its file; above it, the header counts as
# damaged.
_LONGEST = 100


def recover(path: Path, output: Path | None = None) -> list[RecoveryReport]:
    """
    Recover a recording of any storage; return one report per MCAP file, or one report for any other recording.

    An MCAP file or a folder of them is recovered by `mcap.recovery`. Any other recording is copied to a new bag
    (by default ``<name>.recovered`` in the same folder), unless the recording is intact.

    Raises
    ------
    OSError
        `path` cannot be read or the new bag cannot be written.
    ValueError
        `output` exists, or was given for a folder of MCAP files; or the recording is still running.
    BagError
        There is no recording at `path`.
    """
    files = files_of(path)
    kinds = {storage_of(file) for file in files}
    if not kinds & {"sqlite3", "ros1"}:
        return recovery.recover(path, output)
    target = output if output is not None else path.with_name(f"{path.name.partition('.')[0]}.recovered")
    if target.exists():
        raise ValueError(f"output: {target} exists already")
    logs = [log for file in files for log in file.parent.glob(f"{file.name}-*") if log.stat().st_size]
    try:
        with Bag(path) as bag:
            listed = path.is_file() or (path / FILE_NAME).is_file()
            if bag.complete and listed and not logs:
                return [RecoveryReport(path, sound=True, messages=bag.message_count)]
            return [_copied(bag, target)]
    except BagError as error:
        if kinds != {"sqlite3"}:
            lost = sum(file.stat().st_size for file in files)
            return [RecoveryReport(path, damages=1, lost_bytes=lost, notes=(error.sentence,))]
        return [_saved(path, files, target, error.sentence)]


def _copied(bag: Bag, target: Path) -> RecoveryReport:
    """Copy all readable messages of a bag to a new bag at `target`; return a report."""
    messages = ((log_ns, name, data) for log_ns, name, _, data in bag.messages())
    saved = _write(target, dict(bag.topics), messages)
    return RecoveryReport(
        bag.path,
        target,
        messages=saved,
        damages=int(not bag.complete),
        lost_bytes=bag.lost_bytes,
        start_ns=bag.start_ns,
        end_ns=bag.end_ns,
        notes=tuple(bag.notes),
    )


def _write(target: Path, topics: dict[str, TopicInfo], messages: Iterator[tuple[int, str, bytes]]) -> int:
    """Write messages to a new bag; return their number."""
    with BagWriter(target) as writer:
        channels = {one.name: writer.copy_topic(one) for one in topics.values()}
        for log_ns, name, data in messages:
            writer.write(channels[name], data, log_ns)
        return writer.messages


def _saved(path: Path, files: list[Path], target: Path, reason: str) -> RecoveryReport:
    """
    Copy the messages in all readable rows of damaged databases to a new bag at `target`; return a report.

    If no message can be read, no bag is written.
    """
    with tempfile.TemporaryDirectory(prefix="mwd_recover_") as scratch:
        databases = [_Database(file, Path(scratch) / f"{number}.db3") for number, file in enumerate(files)]
        topics = {name: TopicInfo(name, kind, 1) for one in databases for name, kind in one.topics.values()}
        first = next((row for one in databases for row in one.messages()), None)
        if first is None:
            return RecoveryReport(path, damages=1, lost_bytes=sum(f.stat().st_size for f in files), notes=(reason,))
        times: list[int] = []

        def messages() -> Iterator[tuple[int, str, bytes]]:
            for row in (row for one in databases for row in one.messages()):
                times.append(row[0])
                yield row

        saved = _write(target, topics, messages())
        lost = sum(one.lost for one in databases)
    notes = (reason, f"{lost} rows of messages could not be read") if lost else (reason,)
    return RecoveryReport(path, target, messages=saved, damages=1, start_ns=min(times), end_ns=max(times), notes=notes)


class _Database:
    """A damaged database."""

    def __init__(self, file: Path, copy: Path) -> None:
        for source in (file, *file.parent.glob(f"{file.name}-wal"), *file.parent.glob(f"{file.name}-journal")):
            shutil.copyfile(source, copy.with_name(copy.name + source.name.removeprefix(file.name)))
        self._copy, self._bytes = copy, copy.stat().st_size
        with copy.open("r+b") as opened:
            # SQLite does not open a file shorter than its header states: extend the file; the missing pages become
            # empty.
            head = opened.read(100)
            page = int.from_bytes(head[16:18], "big")
            whole = (page if page != 1 else 65536) * int.from_bytes(head[28:32], "big")
            if self._bytes < whole <= _LONGEST * max(self._bytes, 1):
                opened.truncate(whole)
        self.lost = 0  #: number of rows that could not be read in the last call of `messages`
        self.topics: dict[int, tuple[str, str]] = {}  #: topics by their number in the database
        try:
            rows = self._ask("SELECT id, name, type FROM topics WHERE serialization_format = 'cdr'")
            self.topics = {int(number): (str(name), str(kind)) for number, name, kind in rows}
        except sqlite3.DatabaseError:
            pass

    def messages(self) -> Iterator[tuple[int, str, bytes]]:
        """
        Yield the log time, ns, topic and bytes of each message whose row can be read.

        The search ends after more than `_BARREN` successive ranges of row numbers without a row.
        """
        self.lost = barren = 0
        most = self._bytes // 16
        for begin in itertools.count(1, _STEP):
            if begin > most or barren > _BARREN:
                break
            before = self.lost
            rows = self._rows(begin, begin + _STEP - 1)
            barren = 0 if rows else barren + 1
            if not rows:
                # If no row in this range of row numbers can be read, none is counted as lost: the range may never have
                # had any rows.
                self.lost = before
            for topic, log_ns, data in rows:
                if topic in self.topics and isinstance(log_ns, int) and log_ns >= 0 and isinstance(data, bytes):
                    yield log_ns, self.topics[topic][0], data

    def _rows(self, low: int, high: int) -> list[tuple[int, object, object]]:
        """
        Return the rows (topic number, log time, data) of a range of row numbers, both ends included.

        A range that cannot be read is split in half; a single row that cannot be read is counted in `lost`.
        """
        try:
            return self._ask(
                "SELECT topic_id, timestamp, data FROM messages WHERE id BETWEEN ? AND ? ORDER BY id", (low, high)
            )
        except sqlite3.DatabaseError:
            if low == high:
                self.lost += 1
                return []
        middle = (low + high) // 2
        return self._rows(low, middle) + self._rows(middle + 1, high)

    def _ask(self, query: str, values: tuple[int, ...] = ()) -> list[tuple[int, object, object]]:
        connection = sqlite3.connect(self._copy)
        try:
            return connection.execute(query, values).fetchall()
        finally:
            connection.close()
