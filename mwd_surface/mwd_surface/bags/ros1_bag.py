# SPDX-License-Identifier: Apache-2.0
"""
Reading a ROS 1 recording (``.bag``) with the messages of common types converted to the encoding of ROS 2.

`rosbags` converts the messages (CDR from the ROS 1 serialisation, without the header's sequence number). Topics whose
types do not exist in the common packages of ROS 2 are left out. If the recorder died or the file was cut, the recording
has no index; it is then read once completely to find the messages.
"""

from __future__ import annotations

import bz2
import heapq
import struct
from collections import OrderedDict, defaultdict
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import Chunk, ChunkInfo, Header, IndexData, RecordType, decompressors, read_bytes

from mwd_sensors.core import budgets
from mwd_sensors.core.budgets import BudgetError
from mwd_surface.bags.topic_info import TopicInfo, ros2_types

# Multiple of the recording's decompressed size that may be decompressed in total before the recording is refused.
_AGAIN = 4
_MAGIC = b"#ROSBAG V2.0\n"
# Decompressors whose output can be limited in size.
_BOUNDED: dict[str, Callable[[], bz2.BZ2Decompressor | lz4.frame.LZ4FrameDecompressor]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
}


class Ros1Bag:
    """
    A ROS 1 recording.

    Raises
    ------
    ReaderError, OSError
        The file is not a ROS 1 recording, or cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self._reader = _AnyReader(path)
        self._reader.open()
        self.complete = not self._reader.cut  #: whether the recording has its index
        #: Number of bytes after the place where reading of a file without index ended.
        self.lost_bytes = self._reader.lost_bytes
        #: Sentences on anything unusual.
        self.notes = ["the recording is of ROS 1 and is read by the library rosbags, which is slower"]
        if not self.complete:
            self.notes.append(f"{path.name} has no index because it was not closed: {self._reader.cut}")
        self.topics: dict[str, TopicInfo] = {}  #: topics whose types exist in ROS 2
        self.unreadable: dict[str, TopicInfo] = {}  #: the other topics
        for name, info in self._reader.topics.items():
            type_name = info.connections[0].msgtype
            known = type_name in ros2_types().fielddefs
            problem = "" if known else "its ROS 1 type is not one of ROS 2's common packages"
            (self.topics if known else self.unreadable)[name] = TopicInfo(
                name, type_name, info.msgcount, problem=problem
            )
        filled = [info for info in self._reader.chunk_infos if info.connection_counts]
        #: `start_ns`, `end_ns`: times of the first and the last message; 0 in an empty recording.
        self.start_ns = min((info.start_time for info in filled), default=0)
        self.end_ns = max((info.end_time - 1 for info in filled), default=0)

    def messages(self, topics: list[str], start: int | None, stop: int | None) -> Iterator[tuple[str, int, bytes]]:
        """
        Yield topic, log time in ns, and the bytes of each message in the ROS 2 encoding.

        start, stop : log time from (inclusive) and to (exclusive), ns; None: no limit.
        """
        wanted = [one for one in self._reader.connections if one.topic in topics]
        for connection, log_ns, data in self._reader.messages(wanted, start, stop) if wanted else ():
            yield connection.topic, log_ns, bytes(ros2_types().ros1_to_cdr(data, connection.msgtype))

    def close(self) -> None:
        """Close the file."""
        if self._reader.bio is not None:
            self._reader.close()


class _AnyReader(Reader):
    """Reader of a recording with or without its index."""

    #: Text with the byte at which reading of a file without index ended; empty if the file has an index.
    cut = ""
    lost_bytes = 0

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._sizes: dict[int, int] = {}

    def open(self) -> None:
        """
        Open the file; if it has no index, build an index of the messages that are found.

        A file without the first bytes of a ROS 1 bag raises the error of rosbags.
        """
        try:
            super().open()
        except (ReaderError, struct.error, AssertionError, UnicodeDecodeError, ValueError):
            with self.path.open("rb") as file:
                if file.read(len(_MAGIC)) != _MAGIC:
                    raise
            self.connections, self.chunk_infos, self.chunks, self.indexes = [], [], {}, {}
            self.bio = self.path.open("rb")
            self._index_by_reading()

    def messages(
        self, connections: Collection[Connection] = (), start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """
        Yield connection, time in ns, and the bytes of each message in order of time.

        The reader of rosbags caches one chunk: if the messages of two chunks alternate, that reader decompresses a
        chunk for each message. This reader keeps the last few chunks decompressed.

        Raises
        ------
        BudgetError
            More chunks overlap in time than are kept, so that they would be decompressed again and again.
        """
        file: BinaryIO = self.bio  # type: ignore[assignment]
        known, held, work = {one.id: one for one in self.connections}, OrderedDict[int, BytesIO](), 0
        for entry in heapq.merge(*(self.indexes[one.id] for one in connections or self.connections)):
            if start is not None and entry.time < start:
                continue
            if stop is not None and entry.time >= stop:
                return
            if entry.chunk_pos not in held:
                about = self.chunks[entry.chunk_pos]
                file.seek(about.datapos)
                held[entry.chunk_pos] = BytesIO(about.decompressor(read_bytes(file, about.datasize)))
                work += held[entry.chunk_pos].getbuffer().nbytes
                while len(held) > 1 and sum(one.getbuffer().nbytes for one in held.values()) > budgets.FREE:
                    held.popitem(last=False)
                if work > budgets.FREE + _AGAIN * max(sum(self._sizes.values()), self.path.stat().st_size):
                    raise BudgetError("has chunks that overlap in time: they would be unpacked again and again")
            held.move_to_end(entry.chunk_pos)
            yield self._message_at(held[entry.chunk_pos], entry, known)

    def _message_at(
        self, chunk: BytesIO, entry: IndexData, known: Mapping[int, Connection]
    ) -> tuple[Connection, int, bytes]:
        """
        Return connection, time, ns, and bytes of the message to which an entry of the index points.

        Raises ReaderError if the entry does not point to a message of a known connection.
        """
        chunk.seek(entry.offset)
        while (header := Header.read(chunk)).get_uint8("op") == RecordType.CONNECTION:
            chunk.seek(struct.unpack("<L", read_bytes(chunk, 4))[0], 1)
        if header.get_uint8("op") != RecordType.MSGDATA or header.get_uint32("conn") not in known:
            raise ReaderError("the index points to a place without a message")
        data = read_bytes(chunk, struct.unpack("<L", read_bytes(chunk, 4))[0])
        return known[header.get_uint32("conn")], entry.time, data

    def read_chunk(self) -> Chunk:
        """Return the chunk at the present position of the file, with a function that decompresses within the budget."""
        position = self.bio.tell() if self.bio is not None else 0
        chunk = super().read_chunk()
        compression = next(name for name, one in decompressors.items() if one is chunk.decompressor)
        return chunk._replace(decompressor=self._bounded(position, compression))

    def _bounded(self, position: int, compression: str) -> Callable[[bytes], bytes]:
        """Return the function that decompresses the chunk at a byte position; bz2 and lz4 have a size limit."""
        if compression not in _BOUNDED:
            return decompressors[compression]
        return partial(self._unpacked, _BOUNDED[compression], position)

    def _unpacked(self, make: Callable[[], Any], position: int, data: bytes) -> bytes:
        """
        Return the decompressed records of a chunk; `make` returns a decompressor.

        Raises BudgetError if the records are too large, and ReaderError if they are damaged.
        """
        most = budgets.ROS1.unpacked or 0
        unpacker = make()
        try:
            plain = bytes(unpacker.decompress(data, max_length=most + 1))
        except Exception as error:
            # bz2 and lz4 raise different kinds of errors.
            raise ReaderError(f"a chunk does not decompress: {error}") from error
        budgets.ROS1.check("unpacked", len(plain))
        if not unpacker.eof:
            raise ReaderError("a chunk does not decompress: it is not complete")
        self._sizes[position] = len(plain)
        budgets.ROS1.check_ratio(self.path.stat().st_size, sum(self._sizes.values()))
        return plain

    def _index_by_reading(self) -> None:
        """
        Index the file by reading it chunk by chunk, up to the end of the file or the first damage.

        `cut` then says where reading ended, and `lost_bytes` how many bytes follow.
        """
        file: BinaryIO = self.bio  # type: ignore[assignment]
        size = self.path.stat().st_size
        file.seek(len(_MAGIC))
        indexes: dict[int, list[IndexData]] = defaultdict(list)
        position = file.tell()
        self.cut = f"read to its end, byte {size}"
        while position < size:
            try:
                header = Header.read(file)
                length = struct.unpack("<L", read_bytes(file, 4))[0]
                if header.get_uint8("op") == RecordType.CHUNK:
                    self._index_chunk(position, header, length, indexes)
                else:
                    file.seek(min(length, size - file.tell()), 1)
            except (ReaderError, struct.error, UnicodeDecodeError) as error:
                self.cut = f"read to byte {position} of {size} ({error.args[0]})"
                self.lost_bytes = size - position
                break
            position = file.tell()
        self.indexes = {one.id: sorted(indexes[one.id]) for one in self.connections}
        self.connections = [one._replace(msgcount=len(self.indexes[one.id])) for one in self.connections]

    def _index_chunk(self, position: int, header: Header, length: int, indexes: dict[int, list[IndexData]]) -> None:
        """
        Index the messages of a chunk; if an uncompressed chunk is cut off, the messages before the cut.

        Raises ReaderError if the chunk is cut off, damaged or too large, or its compression is not known.
        """
        file: BinaryIO = self.bio  # type: ignore[assignment]
        begin = file.tell()
        compression = header.get_string("compression")
        data = file.read(length)
        whole = len(data) == length
        if compression not in decompressors:
            raise ReaderError(f"the compression {compression!r} is not known")
        if not whole and compression != "none":
            raise ReaderError("the file ends inside a compressed chunk")
        unpack = self._bounded(position, compression)
        try:
            plain = BytesIO(unpack(data))
        except BudgetError as error:
            raise ReaderError(f"a chunk {error}") from error
        times: dict[int, list[int]] = defaultdict(list)
        end = 0
        try:
            while end < len(plain.getbuffer()):
                self._index_record(plain, position, times, indexes)
                end = plain.tell()
        except (ReaderError, struct.error):
            if whole:
                raise
        spans = [time for mine in times.values() for time in mine]
        counts = {number: len(mine) for number, mine in times.items()}
        if spans:
            self.chunk_infos.append(ChunkInfo(position, min(spans), max(spans) + 1, counts))
            self.chunks[position] = Chunk(length if whole else len(data), begin, unpack)
        if not whole:
            raise ReaderError("the file ends inside a chunk")

    def _index_record(
        self, plain: BytesIO, position: int, times: dict[int, list[int]], indexes: dict[int, list[IndexData]]
    ) -> None:
        """Add the record at the present position of `plain` to the connections or to the index, and move past it."""
        offset = plain.tell()
        header = Header.read(plain)
        kind = header.get_uint8("op")
        if kind == RecordType.CONNECTION:
            plain.seek(offset)
            file, self.bio = self.bio, plain
            try:
                connection = self.read_connection()
            finally:
                self.bio = file
            if all(one.id != connection.id for one in self.connections):
                self.connections.append(connection)
            return
        length = struct.unpack("<L", read_bytes(plain, 4))[0]
        read_bytes(plain, length)
        if kind == RecordType.MSGDATA:
            number, time = header.get_uint32("conn"), header.get_time("time")
            indexes[number].append(IndexData(time, position, offset))
            times[number].append(time)
