# SPDX-License-Identifier: Apache-2.0
"""
The files of a bag: finding and opening them, their topics and time span, and notes on anything unusual.

A bag is a rosbag2 directory, or a bare ``.mcap`` or ``.db3`` file; files that are compressed as a whole are
decompressed first.
"""

from __future__ import annotations

import contextlib
import dataclasses
import filecmp
import heapq
import itertools
import os
import re
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import quote

import numpy as np
import zstandard
from rosbags.interfaces import MessageDefinitionFormat
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import BudgetError
from mwd_sensors.core.input_files import check_regular, open_regular
from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_metadata import BagMetadata, MetadataError
from mwd_surface.bags.mcap.contents import Contents
from mwd_surface.bags.mcap.reader import McapFile
from mwd_surface.bags.mcap.records import MAGIC, Decompressor, FormatError
from mwd_surface.bags.mcap.walk import walk_records
from mwd_surface.bags.mcap.writer import is_being_written
from mwd_surface.bags.ros1_bag import Ros1Bag
from mwd_surface.bags.topic_info import CDR, PACKED, REMEDY, ROS1, TopicInfo, cdr_problem, listed, read_as

__all__ = ["BagError", "BagFiles", "TopicInfo"]

# Storage by the first bytes of a file, and by the ending of its name. Other endings in a folder are ignored.
_BEGINNINGS = {MAGIC: "mcap", b"SQLite format 3\0": "sqlite3", b"#ROSBAG V": "ros1"}
_STORAGES = {".mcap": "mcap", ".db3": "sqlite3", ".bag": "ros1"}
# A channel does not have its declared encoding if its first messages, at most _PROBED, all contradict the declaration.
# In MCAP files, only the first _PROBED_SPANS spans with untested channels are searched for these messages.
_PROBED, _PROBED_SPANS = 3, 8
_SAID = 4  # largest number of differences between metadata.yaml and the files that a note lists


class BagError(Exception):
    """Raised if a bag cannot be used; `sentence` describes the problem, and `hint` the remedy."""

    def __init__(self, sentence: str, hint: str = "") -> None:
        super().__init__(f"{sentence}; {hint}" if hint else sentence)
        self.sentence = sentence
        self.hint = hint


@dataclasses.dataclass
class OpenedMcap:
    """An opened MCAP file of a bag."""

    file: McapFile
    contents: Contents
    names: dict[int, str] = dataclasses.field(default_factory=dict)  #: topic name by channel number
    #: Message type by channel number, for channels in the ROS 1 encoding.
    ros1: dict[int, str] = dataclasses.field(default_factory=dict)


class BagFiles:
    """
    The opened files of a bag.

    Parameters
    ----------
    path : Path
        The bag, or the folder of a run, well or results that contains one bag.

    Raises
    ------
    BagError
        `path` does not exist, is not a bag, or holds no message.
    """

    def __init__(self, path: Path) -> None:
        self.path = recording_of(path)
        self.topics: dict[str, TopicInfo] = {}  #: topics whose messages can be read
        #: Topics whose messages cannot be read; `TopicInfo.problem` is the reason.
        self.unreadable: dict[str, TopicInfo] = {}
        #: Log times of the first and the last message; both are 0 in an empty recording.
        self.start_ns = self.end_ns = 0
        #: One sentence for each thing that was unusual or damaged; the list grows while reading.
        self.notes: list[str] = []
        self.complete = True  #: false if the recording is known to be cut off or damaged
        #: Number of bytes of a ROS 1 recording after the place where reading ended.
        self.lost_bytes = 0
        self.custom: dict[str, str] = {}  #: the table ``custom_data`` of metadata.yaml
        #: The files that are read, as found on the disk, and their total size.
        self.files: list[Path] = []
        self.size_bytes = 0
        self.storage = ""  #: ``mcap``, ``sqlite3`` or ``ros1``
        self.message_compression = False  #: whether each message is compressed separately
        self.mcap: list[OpenedMcap] = []  #: the opened files; empty for other storage
        self._probed: set[str] = set()
        self.other: DatabaseFiles | Ros1Bag | None = None  #: reader of a bag with other storage; None for MCAP
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the files, including the files of `other`, and delete the temporary folder of unpacked files."""
        for one in self.mcap:
            one.file.close()
        self.mcap = []
        if self.other is not None:
            self.other.close()
        if self._scratch is not None:
            self._scratch.cleanup()
            self._scratch = None

    def _open(self) -> None:
        if not self.path.exists():
            raise BagError(f"there is nothing at {self.path}", "check the path; a bag is a folder or an .mcap file")
        files, about = self._directory()
        if not files:
            reason = f" ({'; '.join(self.notes)})" if self.notes else ""
            raise BagError(f"{self.path} holds no recording{reason}", "give a folder with .mcap or .db3 files")
        files = self._of_one_storage(files, about.storage if about else "")
        self.files, self.size_bytes = files, sum(file.stat().st_size for file in files)
        if self.storage == "mcap":
            self._open_mcap(files)
        else:
            self._open_other(files)
        if about is not None:
            self._compare_counts(about)
        unread = [topic for topic in self.unreadable.values() if topic.count]
        if any(topic.count for topic in self.topics.values()):
            self.notes += [f"not read: {listed(unread)}"] if unread else []
            return
        if unread:
            raise BagError(f"{self.path} has no message that can be read here: {listed(unread)}", REMEDY)
        reason = "; ".join(self.notes)
        raise BagError(f"{self.path} holds no message" + (f" ({reason})" if reason else ""), "record it again")

    def _directory(self) -> tuple[list[Path], BagMetadata | None]:
        """
        Return the files to read, and the contents of metadata.yaml (None if it is missing or cannot be read).

        The files are those that metadata.yaml names, then the other recording files in the folder, without copies.
        """
        there = files_of(self.path)
        if self.path.is_file():
            return there, None
        try:
            about = bag_metadata.read(self.path)
        except MetadataError as error:
            # A recorder writes metadata.yaml at the end.
            if there and not is_being_written(self.path):
                self.notes.append(f"{error}; the files in the folder are read")
            return there, None
        self.custom = dict(about.custom)
        self.message_compression = about.compression_mode == "message"
        named = [self.path / file.path for file in about.files]
        listed = [file for file in named if file.is_file()]
        missing = [file.name for file in named if not file.is_file()]
        if missing:
            self.notes.append(f"files named in metadata.yaml are missing: {', '.join(missing)}")
        # A player that decompressed a file leaves both the compressed and the plain file in the folder.
        plain = {_plain_name(file) for file in listed}
        extra: list[Path] = []
        copies: list[Path] = []
        for file in there:
            if file not in listed and _plain_name(file) not in plain:
                (copies if any(_same(file, other) for other in listed) else extra).append(file)
        if copies:
            self.notes.append(
                f"{', '.join(file.name for file in copies)} left out, because it is a copy of a file of the recording"
            )
        if extra:
            self.notes.append(
                f"{', '.join(file.name for file in extra)} also read, although metadata.yaml does not name it"
            )
        return listed + extra, about

    def _of_one_storage(self, files: list[Path], stated: str) -> list[Path]:
        """
        Return the files that have the stated storage, else the most frequent storage; note the files left out.

        Raises BagError if no file is a recording.
        """
        found = {file: storage_of(file) for file in files}
        storages = [storage for storage in found.values() if storage]
        if not storages:
            raise BagError(f"{self.path} is not a bag", "expected a folder with metadata.yaml, an .mcap, .db3 or .bag")
        self.storage = stated if stated in storages else max(set(storages), key=storages.count)
        if stated and stated != self.storage:
            self.notes.append(f"metadata.yaml says that the storage is {stated}; it is {self.storage}")
        other = [file for file in files if found[file] != self.storage]
        for file in other:
            what = f"a recording of another storage ({found[file]})" if found[file] else "not a recording"
            self.notes.append(f"{file.name} is {what} and is left out")
        return [file for file in files if file not in other]

    def _compare_counts(self, about: BagMetadata) -> None:
        """Add a note on contradictions between metadata.yaml and the files; the contents of the files are used."""
        said = []
        for topic in about.topics:
            found = self.topics.get(topic.name) or self.unreadable.get(topic.name)
            count, type_name = (found.count, found.type_name) if found is not None else (0, topic.type_name)
            if found is not None and type_name != topic.type_name:
                said.append(f"{topic.name} is {topic.type_name} there, but {type_name} in the files")
            elif count != topic.count and self.complete:
                said.append(f"{topic.name} has {topic.count} messages there, but {count} in the files")
        if said:
            more = " ..." if len(said) > _SAID else ""
            self.notes.append(f"metadata.yaml is wrong and not used: {'; '.join(said[:_SAID])}{more}")

    def _open_mcap(self, files: list[Path]) -> None:
        problems = []
        for path in files:
            try:
                file = McapFile(self._unpacked(path))
            except FormatError as error:
                problems.append(f"{path.name}: {error}")
                continue
            except OSError as error:
                problems.append(f"{path.name} cannot be opened: {error.strerror}")
                continue
            contents = file.contents()
            self.mcap.append(OpenedMcap(file, contents))
            if is_being_written(path):
                self.notes.append(f"{path.name} is being recorded: messages that come from now on are not read")
            else:
                self.notes += contents.notes
            self.complete = self.complete and contents.complete
        if problems and not self.mcap:
            raise BagError(f"{self.path} cannot be read: {'; '.join(problems)}", "`mwd recover` may save parts of it")
        if problems:
            self.notes += [f"{problem}; skipped" for problem in problems]
            self.complete = False
        bad = [self._join_topics(one) for one in self.mcap]
        for name in self.topics.keys() & self.unreadable.keys():
            # The topic has messages in two encodings: keep only the messages that can be read.
            left = self.unreadable.pop(name)
            self.notes.append(f"{left.count} messages of {name} are left out: {left.problem}")
        for one, numbers in zip(self.mcap, bad, strict=True):
            for number in [number for number in numbers if one.names.get(number) in self.topics]:
                del one.names[number]
        if any(one.ros1 for one in self.mcap):
            self.notes.append(
                "messages are in the encoding of ROS 1 and are converted while they are read, which is slower"
            )
        spans = [span for one in self.mcap for span in one.contents.spans]
        if spans:
            self.start_ns = min(span.start_ns for span in spans)
            self.end_ns = max(span.end_ns for span in spans)
        if not all(one.contents.checksums for one in self.mcap):
            self.notes.append("the recording carries no checksums: damage inside it would not be seen")
        if self.message_compression:
            self.notes.append("messages are compressed one by one: read slowly")

    def _join_topics(self, one: OpenedMcap) -> set[int]:
        """
        Add the channels of an MCAP file to the topics; return the numbers of the channels that cannot be read.

        A channel whose topic is known with another type or problem is noted and left out.
        """
        # Test the encoding of a topic only in the first file with its messages, so that a day in a hundred files opens
        # as fast as a single file.
        contents = one.contents
        fresh = {number for number, channel in contents.channels.items() if channel.topic not in self._probed}
        problems = _probed(one.file, contents, fresh)
        filled = [
            k for k in fresh if contents.counts.get(k, 0) and contents.channels[k].message_encoding.lower() == CDR
        ]
        if self._all_packed([problems.get(number, "") for number in filled]):
            problems = {}
        self._probed |= {contents.channels[number].topic for number in fresh if contents.counts.get(number, 0)}
        bad: set[int] = set()
        for number, channel in contents.channels.items():
            schema = contents.schemas.get(channel.schema_id)
            kind, declared = (schema.encoding, schema.name) if schema else ("", "")
            type_name, encoding, problem = read_as(channel.message_encoding, kind, declared)
            former = self.unreadable.get(channel.topic)
            problem = problem or problems.get(number, former.problem if former and number not in fresh else "")
            there = self.unreadable if problem else self.topics
            known = there.get(channel.topic)
            if known is not None and (known.type_name, known.problem) != (type_name, problem):
                self.notes.append(
                    f"{channel.topic} has messages of {known.type_name} and of {type_name}; the latter are left out"
                )
                continue
            from_ros1 = encoding == ROS1 and not problem
            there[channel.topic] = TopicInfo(
                channel.topic,
                type_name,
                contents.counts.get(number, 0) + (known.count if known else 0),
                kind if not from_ros1 else "",
                schema.data.decode(errors="replace") if schema and not from_ros1 else "",
                channel.metadata.get("topic_type_hash", ""),
                channel.metadata.get("offered_qos_profiles", ""),
                CDR if from_ros1 else encoding,
                problem,
            )
            one.names[number] = channel.topic
            if problem:
                bad.add(number)
            if from_ros1:
                one.ros1[number] = type_name
        orphans = sum(count for number, count in contents.counts.items() if number not in contents.channels)
        if orphans:
            self.notes.append(f"{orphans} messages were left out, because the declaration of their topic is lost")
            self.complete = False
        return bad

    def _open_other(self, files: list[Path]) -> None:
        try:
            plain = [self._unpacked(file) for file in files]
            for file in plain:
                check_regular(file, budgets.ROS1 if self.storage == "ros1" else budgets.DATABASE)
            self.other = Ros1Bag(plain[0]) if self.storage == "ros1" else DatabaseFiles(plain, self._scratch_folder)
        except Exception as error:
            # Catch every exception, because rosbags, sqlite and the YAML parser raise different kinds.
            hint = "`mwd recover` may save parts of it" if self.storage == "sqlite3" else "was it recorded to the end?"
            raise BagError(f"{self.path} cannot be read: {error}", hint) from error
        self.topics, self.unreadable = self.other.topics, self.other.unreadable
        self.start_ns, self.end_ns = self.other.start_ns, self.other.end_ns
        self.notes += self.other.notes
        self.complete = self.complete and self.other.complete
        self.lost_bytes = self.other.lost_bytes if isinstance(self.other, Ros1Bag) else 0
        problems: dict[str, str] = {}
        for name, about in list(self.topics.items()):
            messages = self.other.messages([name], None, None) if about.count else iter(())
            first = [bytes(data) for _, _, data in itertools.islice(messages, _PROBED)]
            if first:
                problems[name] = cdr_problem(first, about.type_name)
        if self._all_packed(list(problems.values())):
            self.notes.append("messages are compressed one by one: read slowly")
            return
        for name, problem in problems.items():
            if problem:
                self.unreadable[name] = dataclasses.replace(self.topics.pop(name), problem=problem)

    def _all_packed(self, problems: list[str]) -> bool:
        """
        Return whether the messages of all topics are compressed one by one; correct `message_compression`.

        problems : result of `cdr_problem` for each tested topic. If metadata.yaml contradicts the results, the results
        decide.
        """
        packed = bool(problems) and all(problem == PACKED for problem in problems)
        if self.message_compression and problems and PACKED not in problems:
            self.message_compression = False
            self.notes.append("metadata.yaml says that messages are compressed one by one; they are not")
        self.message_compression = self.message_compression or packed
        return packed

    def _scratch_folder(self) -> Path:
        self._scratch = self._scratch or tempfile.TemporaryDirectory(prefix="mwd_bag_")
        return Path(self._scratch.name)

    def _unpacked(self, path: Path) -> Path:
        if path.suffix != ".zstd":
            return path
        target = self._scratch_folder() / path.stem
        try:
            size = check_regular(path, budgets.MCAP)
            with path.open("rb") as packed, target.open("wb") as plain:
                for piece in zstandard.ZstdDecompressor().read_to_iter(packed):
                    plain.write(piece)
                    budgets.MCAP.check_ratio(size, plain.tell())
        except zstandard.ZstdError as error:
            raise FormatError(f"the file does not decompress: {error}") from error
        except BudgetError as error:
            raise FormatError(f"the file {error}") from error
        self.notes.append(f"{path.name} was decompressed to a temporary file first")
        return target


def _suffix(path: Path) -> str:
    return Path(path.stem).suffix if path.suffix == ".zstd" else path.suffix


def _plain_name(path: Path) -> str:
    """Return the name of a file without the ending .zstd."""
    return path.name.removesuffix(".zstd")


def _same(file: Path, other: Path) -> bool:
    """Return whether two files have the same contents."""
    return file.stat().st_size == other.stat().st_size and filecmp.cmp(file, other, shallow=False)


def recording_of(path: Path) -> Path:
    """
    Return the recording at a path: the path itself, or the only recording in the folder of a run, well or results.

    The path is also returned if nothing is found.

    Raises
    ------
    BagError
        The folder of the run holds several recordings; the message names them.
    """
    if not path.is_dir() or files_of(path) or (path / bag_metadata.FILE_NAME).is_file():
        return path
    found = sorted(
        {place for layout in ("bags/*", "*/bags/*", "merged") for place in path.glob(layout) if place.is_dir()}
    )
    if len(found) > 1:
        raise BagError(f"{path} holds {len(found)} recordings", f"give one of {', '.join(map(str, found))}")
    return found[0] if found else path


def files_of(path: Path) -> list[Path]:
    """Return the files of a recording: the file itself, or those of a folder, ordered by the number in the name."""
    if not path.is_dir():
        return [path]
    return sorted(
        (file for file in path.iterdir() if _suffix(file) in _STORAGES and file.is_file()),
        key=lambda file: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)],
    )


def storage_of(path: Path) -> str:
    """
    Return the storage of a file ("mcap", "sqlite3", "ros1") by its first bytes, else by its name; "" if unknown.

    The storage of a compressed file (.zstd) is found by its name only.
    """
    if path.suffix != ".zstd":
        try:
            with os.fdopen(open_regular(path), "rb") as file:
                begin = file.read(16)
        except OSError:
            begin = b""
        for beginning, storage in _BEGINNINGS.items():
            if begin.startswith(beginning):
                return storage
    return _STORAGES.get(_suffix(path), "")


def _probed(file: McapFile, contents: Contents, numbers: set[int]) -> dict[int, str]:
    """
    Return, by channel number, the reason why the first messages of a channel declared as CDR are not CDR.

    numbers : channels to test. Channels whose messages are CDR are left out, and channels without a message in the
    spans that are read.
    """
    waiting = {
        number
        for number in numbers
        if contents.channels[number].message_encoding.lower() == CDR and contents.counts.get(number, 0)
    }
    problems: dict[int, str] = {}
    decompress = Decompressor()
    spans = sorted(contents.spans, key=lambda span: span.offset)
    spans = [span for span in spans if span.channels is None or not waiting.isdisjoint(span.channels)]
    for span in spans[:_PROBED_SPANS]:
        if not waiting:
            break
        if span.channels is not None and waiting.isdisjoint(span.channels):
            continue
        try:
            plain = file.plain(span, decompress)
        except FormatError:
            continue
        walk = walk_records(np.frombuffer(plain, dtype=np.uint8))
        for number in waiting & set(np.unique(walk.channel).tolist()):
            rows = np.flatnonzero(walk.channel == number)[:_PROBED].tolist()
            found = [plain[walk.offset[k] : walk.offset[k] + walk.size[k]] for k in rows]
            schema = contents.schemas.get(contents.channels[number].schema_id)
            if problem := cdr_problem(found, schema.name if schema else ""):
                problems[number] = problem
            waiting.discard(number)
    return problems


# Reading the ``.db3`` files of a bag (sqlite3 storage) through `rosbags`, merged by time.


# Endings of the logs that SQLite leaves next to a database that was not closed.
_LOGS = ("-wal", "-journal")
_SCHEMAS = {MessageDefinitionFormat.MSG: "ros2msg", MessageDefinitionFormat.IDL: "ros2idl"}


class DatabaseFiles:
    """
    Opened ``.db3`` files.

    Parameters
    ----------
    scratch : callable
        Returns a temporary folder that exists as long as the bag is open.

    Raises
    ------
    ReaderError
        No file can be read.
    """

    def __init__(self, files: list[Path], scratch: Callable[[], Path]) -> None:
        # See `ros1_bag.Ros1Bag`; `complete` is false if one of several files cannot be read.
        self.topics: dict[str, TopicInfo] = {}
        self.unreadable: dict[str, TopicInfo] = {}
        self.notes = ["the recording has .db3 storage and is read by the library rosbags, which is slower"]
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
        """
        Yield topic, log time in ns, and bytes of each message, in time order over all files.

        start, stop : log time from (inclusive) and to (exclusive), ns; None: no limit.
        """

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
        """Return the file or, if SQLite left a log next to it, a copy that includes the messages of the log."""
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
        self.notes.append(f"{path.name} was not closed by its recorder; it was read with {names} from a temporary copy")
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


# Check of an SQLite recording before `rosbags` opens the file: all rows must be stored in the file, not computed.


# Words in the SQL definition of a table whose rows or columns are computed.
_COMPUTED = {"VIRTUAL", "GENERATED", "AS"}


def is_cut_off(path: Path) -> bool:
    """Return whether an MCAP file of a recording lacks its last bytes, so that messages may be missing."""
    for file in path.glob("*.mcap") if path.is_dir() else [path]:
        if file.suffix == ".mcap":
            with file.open("rb") as opened:
                opened.seek(-len(MAGIC), os.SEEK_END)
                if opened.read() != MAGIC:
                    return True
    return False


def check_database(path: Path) -> None:
    """
    Refuse a database with views, virtual or computed tables, which can yield endless rows from a few hundred bytes.

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
        raise FormatError(f"it is not a readable SQLite database: {error}") from error
    for kind, name, sql in rows:
        if kind == "index" or (kind == "table" and not _COMPUTED & set(str(sql or "").upper().split())):
            continue
        raise FormatError(f"its {kind} {str(name)[:60]!r} is computed; only plain tables are read")
