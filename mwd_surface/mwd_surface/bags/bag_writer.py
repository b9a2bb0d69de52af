# SPDX-License-Identifier: Apache-2.0
"""
Writing a rosbag2 directory of MCAP files, message by message or a million rows at a time.

The recorder, the simulator and the offline estimator all write through `BagWriter`, so that every bag of this project
opens in `ros2 bag`, `rosbags`, `mcap` and Foxglove.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Attachment, Channel, Schema
from numpy.typing import ArrayLike, NDArray

from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_metadata import BagMetadata, File, Topic
from mwd_surface.bags.definitions import DefinitionError, Definitions, installed
from mwd_surface.bags.mcap.writer import McapWriter
from mwd_surface.bags.topic_info import TopicInfo

# Name of the metadata record of an MCAP file that repeats the contents of metadata.yaml.
ROSBAG2_RECORD = "rosbag2"


@dataclasses.dataclass
class _Track:
    """One topic of one type, with its message count over all files of the bag."""

    channel: Channel
    schema: Schema
    qos: list[dict[str, Any]]
    count: int = 0

    def about(self, count: int) -> Topic:
        """Return the entry of the topic in metadata.yaml, with a number of messages."""
        type_hash = self.channel.metadata["topic_type_hash"]
        return Topic(self.channel.topic, self.schema.name, count, type_hash, self.qos)


class BagWriter:
    """
    Writer of a bag: ``<path>/<name>_0.mcap``, ``_1.mcap``... and ``metadata.yaml``.

    Parameters
    ----------
    path : Path
        Folder of the bag; must not exist.
    definitions : Definitions, optional
        Source of the schema texts; by default the definitions of this installation.
    in_place : bool
        False: write to a temporary folder next to `path` and rename it to `path` on `close`; a failure leaves nothing.
        True: write in `path` from the beginning and update metadata.yaml at the end of each file, as a recorder needs.
    compression, chunk_bytes
        See `McapWriter`.
    custom : mapping of str, optional
        Table ``custom_data`` of metadata.yaml, for information that people may need about the bag.

    Raises
    ------
    FileExistsError
        `path` exists already.
    OSError
        Writing fails; every method that writes may raise this.
    """

    def __init__(
        self,
        path: Path | str,
        definitions: Definitions | None = None,
        *,
        in_place: bool = False,
        compression: str = "zstd",
        chunk_bytes: int = 1024 * 1024,
        custom: Mapping[str, str] | None = None,
    ) -> None:
        self.path = Path(path)
        if self.path.exists():
            raise FileExistsError(f"{self.path} exists already; choose another name or remove it first")
        self.definitions = definitions or installed()
        self.custom = dict(custom or {})
        self.files: list[File] = []
        self._compression, self._chunk_bytes = compression, chunk_bytes
        self._folder = self.path if in_place else self.path.with_name(f".{self.path.name}.unfinished")
        if not in_place and self._folder.exists():
            shutil.rmtree(self._folder)
        self._in_place = in_place
        self._folder.mkdir(parents=True)
        self._tracks: dict[int, _Track] = {}
        self._by_name: dict[tuple[str, str], int] = {}
        # Keyed by type and definition, because copied topics may have an older definition of the same type.
        self._schemas: dict[tuple[str, bytes], Schema] = {}
        self._open = True
        self._finished_bytes = 0
        self._next = 0
        self._noted = False
        self.file = self._new_file()

    @property
    def messages(self) -> int:
        """Number of messages accepted so far."""
        return sum(file.count for file in self.files) + (self.file.messages if self._open else 0)

    @property
    def bytes_written(self) -> int:
        """Bytes in all files so far."""
        return self._finished_bytes + (self.file.size if self._open else 0)

    def topic(
        self,
        name: str,
        type_name: str,
        qos: str | Sequence[Mapping[str, Any]] = (),
        type_hash: str = "",
        *,
        need_definition: bool = True,
    ) -> int:
        """
        Return the channel number of a topic and declare the topic on first use.

        Parameters
        ----------
        name : str
            Full name, for example ``/well_7/imu/data_raw``.
        type_name : str
            ``package/msg/Name``.
        qos : YAML text or list of tables
            Offered profiles, in a form that `bag_metadata.parse_qos` accepts.
        type_hash : str
            RIHS01 hash reported by the middleware; by default computed.
        need_definition : bool
            False: record a type whose definition is unknown here without a definition, as rosbag2 does.

        Raises
        ------
        DefinitionError
            The type is unknown and `need_definition` is true.
        ValueError
            `qos` cannot be parsed.
        """
        known = self._by_name.get((name, type_name))
        if known is not None:
            return known
        profiles = bag_metadata.parse_qos(qos)
        text = ""
        try:
            definition = self.definitions.definition(type_name)
            text, type_hash = definition.text, type_hash or definition.type_hash
        except DefinitionError:
            if need_definition:
                raise
        schema = self._schema(type_name, "ros2msg" if text else "", text)
        metadata = {"offered_qos_profiles": bag_metadata.qos_text(profiles), "topic_type_hash": type_hash}
        return self._declare(name, schema, "cdr", metadata, profiles)

    def copy_topic(self, about: TopicInfo) -> int:
        """
        Declare a topic of another bag, with the schema from that bag, and return its channel number.

        If the other bag has no schema, the schema of this installation is used.

        Raises
        ------
        ValueError
            A topic of that name and type exists already, or the other bag has no schema and its quality of service
            cannot be parsed.
        """
        if (about.name, about.type_name) in self._by_name:
            raise ValueError(f"name: {about.name} of {about.type_name} was declared already")
        if not about.schema:
            return self.topic(about.name, about.type_name, about.qos, about.type_hash, need_definition=False)
        schema = self._schema(about.type_name, about.schema_encoding, about.schema)
        # A text that cannot be parsed stays with the channel, but is not written into metadata.yaml.
        profiles = bag_metadata.qos_if_readable(about.qos)
        metadata = {"offered_qos_profiles": about.qos, "topic_type_hash": about.type_hash}
        return self._declare(about.name, schema, about.serialization, metadata, profiles)

    def _declare(
        self, name: str, schema: Schema, encoding: str, metadata: dict[str, str], qos: list[dict[str, Any]]
    ) -> int:
        """Declare a topic in the current file; return its channel number."""
        channel = Channel(len(self._tracks) + 1, name, encoding, metadata, schema.id)
        self.file.add_channel(channel)
        self._tracks[channel.id] = _Track(channel, schema, qos)
        self._by_name[name, schema.name] = channel.id
        return channel.id

    def _schema(self, type_name: str, encoding: str, text: str) -> Schema:
        """Return the schema of a type for this definition text, and declare it on first use."""
        data = text.encode()
        schema = self._schemas.get((type_name, data))
        if schema is None:
            schema = Schema(len(self._schemas) + 1, data, encoding, type_name)
            self.file.add_schema(schema)
            self._schemas[type_name, data] = schema
        return schema

    def write_records(
        self,
        records: NDArray[np.uint8],
        offset: NDArray[np.int64],
        channel: NDArray[np.uint16],
        log_ns: NDArray[np.int64],
    ) -> None:
        """Write complete MCAP message records, see `McapWriter.write_records`; their channels must be declared."""
        self.file.write_records(records, offset, channel, log_ns)

    def has_definition(self, channel: int) -> bool:
        """Return whether the recording contains the definition of a channel's type."""
        return bool(self._tracks[channel].schema.data)

    def write(self, channel: int, data: bytes, log_ns: int, publish_ns: int | None = None) -> None:
        """
        Write one serialised message.

        log_ns, publish_ns : ns since the epoch; by default, publish_ns is log_ns. A publish_ns before 1970 is written
        as 0.

        Raises
        ------
        ValueError
            log_ns is before 1970 or the channel is unknown.
        """
        self._check(channel, log_ns)
        self.file.write(channel, data, log_ns, log_ns if publish_ns is None else max(publish_ns, 0))

    def write_rows(
        self, channel: int, rows: NDArray[np.uint8], log_ns: ArrayLike, publish_ns: ArrayLike | None = None
    ) -> None:
        """
        Write many serialised messages of one size.

        rows, shape (n, size), uint8: one message per row. log_ns, publish_ns, shape (n,), int64: ns since the epoch.

        Raises
        ------
        ValueError
            The shapes do not match, a stamp is before 1970 or the channel is unknown.
        """
        rows = np.asarray(rows, dtype=np.uint8)
        log = np.asarray(log_ns, dtype=np.int64)
        publish = log if publish_ns is None else np.asarray(publish_ns, dtype=np.int64)
        if rows.ndim != 2 or log.shape != (len(rows),) or publish.shape != log.shape:
            raise ValueError(f"rows: expected (n, size) with n stamps, got {rows.shape} and {log.shape}")
        if len(rows) == 0:
            return
        self._check(channel, int(log.min()))
        self.file.write_rows(channel, rows, log, publish)

    def attach(self, name: str, media_type: str, data: bytes, log_ns: int) -> None:
        """Store a file (a report, a scenario, a calibration) in the bag, with the time log_ns, ns since the epoch."""
        self.file.attach(Attachment(log_ns, log_ns, name, media_type, data))

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Store a named table of strings (versions, parameters) inside the bag."""
        self.file.add_metadata(name, values)

    def split(self, sync: bool = False) -> Path:
        """
        Finish the current file and continue in a new one with the same topics; return the path of the finished file.

        sync : as in `finish_file`.
        """
        done = self.finish_file(sync)
        self.begin_file()
        return done

    def finish_file(self, sync: bool = False) -> Path:
        """
        Finish the current file and return its path; after a failure, the call may be repeated.

        sync : whether to force the file to the disk. The next call must be `begin_file` or `close`.
        """
        if self._open:
            self.check_file()
            self.file.close_chunk()
            if not self._noted:
                self._note_metadata()
                self._noted = True
            self.file.finish(sync)
            self._open = False
            self._finished_bytes += self.file.size
            self.files.append(self._file_entry())
            for channel, count in self.file.counts.items():
                self._tracks[channel].count += count
        if self._in_place:
            bag_metadata.write(self._folder, self.metadata())
        return self.file.path

    def check_file(self) -> None:
        """Raise FileNotFoundError if the current file was moved or deleted; then only `give_up_file` may follow."""
        if _is_gone(self.file.path):
            raise FileNotFoundError(
                errno.ENOENT, "the file was moved or deleted while it was written", str(self.file.path)
            )

    def begin_file(self) -> None:
        """
        Open the next file and declare every topic in it.

        After an OSError no file is left and the call may be repeated.
        """
        file = self._new_file()
        try:
            for schema in self._schemas.values():
                file.add_schema(schema)
            for track in self._tracks.values():
                file.add_channel(track.channel)
        except OSError:
            file.close()
            file.path.unlink()
            self._next -= 1
            raise
        self.file = file
        self._open, self._noted = True, False

    def give_up_file(self) -> int:
        """
        Close the current file without its end, for later recovery; the next call must be `begin_file` or `close`.

        A file that was moved gets its end where it is now. If the folder was moved or deleted, its files do not belong
        to the bag any more. Returns the number of messages that never reached a file, or were in deleted files.
        """
        if not self._open:
            return 0
        lost, folder_gone = 0, _is_gone(self._folder)
        if _is_gone(self.file.path):
            if self.file.deleted():
                lost = self.messages if folder_gone else self.file.messages
            else:
                with contextlib.suppress(OSError):
                    self.file.finish(sync=True)
        lost = max(lost, self.file.discard_pending())
        self.file.close()
        self._open = False
        self._finished_bytes += self.file.size
        if folder_gone:
            self.files = []
            for track in self._tracks.values():
                track.count = 0
        return lost

    def close(self, sync: bool = False) -> Path:
        """
        Finish the bag and return its folder.

        sync : as in `finish_file`.
        """
        if self._open:
            self.finish_file(sync)
        if not self._in_place:
            bag_metadata.write(self._folder, self.metadata())
            self._folder.rename(self.path)
        return self.path

    def abandon(self) -> None:
        """
        Stop without finishing: delete a bag written to a temporary folder.

        Keep a bag written in place, for recovery.
        """
        self.file.close()
        self._open = False
        if not self._in_place:
            shutil.rmtree(self._folder, ignore_errors=True)

    def metadata(self) -> BagMetadata:
        """Return the contents of metadata.yaml for the files finished so far."""
        return BagMetadata(
            files=list(self.files),
            topics=[track.about(track.count) for track in self._tracks.values()],
            custom=self.custom,
        )

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()

    def _check(self, channel: int, log_ns: int) -> None:
        if channel not in self._tracks:
            raise ValueError(f"channel: {channel} was not declared; `topic` returns the number to use")
        if log_ns < 0:
            raise ValueError(f"log_ns: {log_ns} lies before 1970; stamps are ns since the epoch")

    def _new_file(self) -> McapWriter:
        path = self._folder / f"{self.path.name}_{self._next}.mcap"
        file = McapWriter(path, self._compression, self._chunk_bytes)
        self._next += 1
        return file

    def _file_entry(self) -> File:
        return File(self.file.path.name, self.file.start_ns, self.file.end_ns, self.file.messages)

    def _note_metadata(self) -> None:
        # Each file contains the metadata of a bag with this file only, so that the file can be used alone.
        topics = [track.about(self.file.counts[number]) for number, track in self._tracks.items()]
        alone = BagMetadata(files=[self._file_entry()], topics=topics, custom=self.custom)
        self.file.add_metadata(ROSBAG2_RECORD, {"serialized_metadata": bag_metadata.serialized(alone)})


def _is_gone(path: Path) -> bool:
    """Return whether a file or folder is missing; False if the disk does not answer."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return True
    except OSError:
        return False
    return False
