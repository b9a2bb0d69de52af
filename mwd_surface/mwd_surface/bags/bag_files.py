# SPDX-License-Identifier: Apache-2.0
"""
The files of a bag, found and opened: what topics they hold, over what time, and what is unusual about them.

A bag is a rosbag2 directory, or a bare ``.mcap`` or ``.db3`` file; files that are compressed as a whole are
decompressed first.
"""

from __future__ import annotations

import dataclasses
import re
import tempfile
from pathlib import Path

import zstandard
from rosbags.rosbag2 import Reader as RosbagsReader

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import BudgetError
from mwd_sensors.core.input_files import check_regular
from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_metadata import MetadataError
from mwd_surface.bags.db3_check import check_database
from mwd_surface.bags.mcap.contents import Contents
from mwd_surface.bags.mcap.reader import McapFile
from mwd_surface.bags.mcap.records import FormatError
from mwd_surface.bags.ros1_bag import Ros1Reader


class BagError(Exception):
    """A bag that cannot be used: what is wrong in one sentence, and in `hint` what to do about it."""

    def __init__(self, sentence: str, hint: str = "") -> None:
        super().__init__(f"{sentence}; {hint}" if hint else sentence)
        self.sentence = sentence
        self.hint = hint


@dataclasses.dataclass(frozen=True)
class TopicInfo:
    """
    One topic of a bag.

    Attributes
    ----------
    name, type_name : str
    count : int
        Messages, as the bag's index says.
    schema_encoding, schema : str
        Definition of the type inside the bag; empty where it carries none.
    type_hash : str
        RIHS01, empty where unknown.
    qos : str
        Offered profiles as YAML, empty where unknown.
    serialization : str
        ``cdr`` for ROS 2.
    """

    name: str
    type_name: str
    count: int
    schema_encoding: str = ""
    schema: str = ""
    type_hash: str = ""
    qos: str = ""
    serialization: str = "cdr"


class BagFiles:
    """
    The opened files of a bag.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    topics, start_ns, end_ns, notes, files, size_bytes, storage, custom, complete
        As `bag_reader.Bag` has them.
    message_compression : bool
        Each message of it is compressed by itself.
    mcap : list of (McapFile, Contents)
        The files themselves, of MCAP storage.
    names : list of dict of int to str
        Of each of them: channel number to topic.
    rosbags : Reader or None
        What reads any other storage.

    Raises
    ------
    BagError
        There is nothing at `path`, it is no bag, or it holds no message.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, TopicInfo] = {}
        self.start_ns = self.end_ns = 0
        self.notes: list[str] = []
        self.complete = True
        self.custom: dict[str, str] = {}
        self.files: list[Path] = []
        self.size_bytes = 0
        self.storage = ""
        self.message_compression = False
        self.mcap: list[tuple[McapFile, Contents]] = []
        self.names: list[dict[int, str]] = []
        self.rosbags: RosbagsReader | Ros1Reader | None = None
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the files."""
        for file, _ in self.mcap:
            file.close()
        self.mcap = []
        if self.rosbags is not None and self.rosbags.is_open:
            self.rosbags.close()
        if self._scratch is not None:
            self._scratch.cleanup()
            self._scratch = None

    def _open(self) -> None:
        if not self.path.exists():
            raise BagError(f"there is nothing at {self.path}", "check the path; a bag is a folder or an .mcap file")
        files = self._directory() if self.path.is_dir() else [self.path]
        if not files:
            raise BagError(f"{self.path} holds no recording", "a bag has .mcap or .db3 files and a metadata.yaml")
        self.files, self.size_bytes = files, sum(file.stat().st_size for file in files)
        suffixes = {_suffix(file) for file in files}
        self.storage = "sqlite3" if suffixes == {".db3"} else "mcap"
        if suffixes == {".mcap"}:
            self._open_mcap(files)
        elif suffixes == {".db3"}:
            self._open_rosbags(files)
        elif suffixes == {".bag"}:
            self.storage = "ros1"
            self._open_rosbags(files)
        else:
            raise BagError(f"{self.path} is not a bag", "expected a folder with metadata.yaml, an .mcap, .db3 or .bag")
        if not any(topic.count for topic in self.topics.values()):
            reason = "; ".join(self.notes)
            raise BagError(f"{self.path} holds no message" + (f" ({reason})" if reason else ""), "record it again")

    def _directory(self) -> list[Path]:
        there = sorted(
            (file for file in self.path.iterdir() if _suffix(file) in (".mcap", ".db3") and file.is_file()),
            key=lambda file: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)],
        )
        try:
            about = bag_metadata.read(self.path)
        except MetadataError as error:
            if any(_suffix(file) == ".db3" for file in there):
                # rosbags would read the same file again.
                raise BagError(str(error), "mend metadata.yaml, or make it again with `ros2 bag reindex`") from error
            if there:
                self.notes.append(f"{error}; used the files that are there")
            return there
        self.custom = dict(about.custom)
        self.message_compression = about.compression_mode == "message"
        listed = [self.path / file.path for file in about.files]
        missing = [file.name for file in listed if not file.exists()]
        if missing:
            self.notes.append(f"missing: {', '.join(missing)}, named in metadata.yaml")
            self.complete = False
        extra = [file for file in there if file not in listed and not about.compression_mode]
        if extra:
            self.notes.append(f"{', '.join(file.name for file in extra)} read too, although not in metadata.yaml")
        return [file for file in listed if file.exists()] + extra

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
            self.mcap.append((file, contents))
            self.notes += contents.notes
            self.complete = self.complete and contents.complete
        if problems and not self.mcap:
            raise BagError(f"{self.path} cannot be read: {'; '.join(problems)}", "`mwd recover` may save parts of it")
        if problems:
            self.notes += [f"{problem}; skipped" for problem in problems]
            self.complete = False
        for _, contents in self.mcap:
            self.names.append(self._join_topics(contents))
        spans = [span for _, contents in self.mcap for span in contents.spans]
        if spans:
            self.start_ns = min(span.start_ns for span in spans)
            self.end_ns = max(span.end_ns for span in spans)
        if not all(contents.checksums for _, contents in self.mcap):
            self.notes.append("the recording carries no checksums: damage inside it would not be seen")
        if self.message_compression:
            self.notes.append("messages are compressed one by one: read slowly")

    def _join_topics(self, contents: Contents) -> dict[int, str]:
        names = {}
        for number, channel in contents.channels.items():
            schema = contents.schemas.get(channel.schema_id)
            type_name = schema.name if schema else ""
            known = self.topics.get(channel.topic)
            if known is not None and known.type_name != type_name:
                self.notes.append(
                    f"{channel.topic} has messages of {known.type_name} and of {type_name}; the latter are left out"
                )
                continue
            count = contents.counts.get(number, 0) + (known.count if known else 0)
            self.topics[channel.topic] = TopicInfo(
                channel.topic,
                type_name,
                count,
                schema.encoding if schema else "",
                schema.data.decode(errors="replace") if schema else "",
                channel.metadata.get("topic_type_hash", ""),
                channel.metadata.get("offered_qos_profiles", ""),
                channel.encoding,
            )
            names[number] = channel.topic
        orphans = sum(count for number, count in contents.counts.items() if number not in contents.channels)
        if orphans:
            self.notes.append(f"{orphans} messages belong to no topic, for its declaration is lost; left out")
            self.complete = False
        return names

    def _open_rosbags(self, files: list[Path]) -> None:
        path = self.path
        if path.is_file() and path.suffix == ".zstd":
            path = self._unpacked(path)
        try:
            for file in files if path.is_dir() else [path]:
                if self.storage == "sqlite3":
                    check_database(self._unpacked(file))
                else:
                    check_regular(file, budgets.ROS1)
            self.rosbags = Ros1Reader(path) if self.storage == "ros1" else RosbagsReader(path)
            self.rosbags.open()
            if isinstance(self.rosbags, RosbagsReader) and self.message_compression:
                # Done with the budget of a message, by whoever decodes it.
                storage = self.rosbags.storage
                storage.metadata = storage.metadata._replace(compression_mode=None)
        except Exception as error:
            # rosbags, sqlite and its YAML parser each raise their own kinds.
            raise BagError(f"{self.path} cannot be read: {error}", "was it recorded to the end?") from error
        left_out = self.rosbags.left_out if isinstance(self.rosbags, Ros1Reader) else []
        if left_out:
            self.notes.append(f"not read, of types that are no common ones: {', '.join(left_out)}")
        for name, info in self.rosbags.topics.items():
            if name in left_out:
                continue
            connection = info.connections[0]
            self.topics[name] = TopicInfo(
                name,
                connection.msgtype,
                info.msgcount,
                info.msgdef.format.name.lower(),
                info.msgdef.data,
                connection.digest,
                "",
                getattr(connection.ext, "serialization_format", "cdr"),
            )
        if self.rosbags.message_count:
            self.start_ns, self.end_ns = self.rosbags.start_time, self.rosbags.end_time - 1
        kind = "a recording of ROS 1" if self.storage == "ros1" else f"{files[0].suffix} storage"
        self.notes.append(f"{kind}: read through rosbags, which is slower")

    def _unpacked(self, path: Path) -> Path:
        if path.suffix != ".zstd":
            return path
        self._scratch = self._scratch or tempfile.TemporaryDirectory(prefix="mwd_bag_")
        target = Path(self._scratch.name) / path.stem
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
