# SPDX-License-Identifier: Apache-2.0
"""
Writer of one MCAP file: chunks of messages with CRC and index, attachments, and a summary at the end.

A chunk is the unit that survives a crash: everything up to the last complete chunk can be read without the summary.
Schemas and channels are therefore written twice: uncompressed, where a reader finds them directly, and in the next
chunk, where its CRC protects them. Every `REPEAT`-th chunk repeats all of them, so that damage in one place cannot lose
the names of all later topics.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

from mwd_surface import __version__
from mwd_surface.bags.mcap.records import (
    INDEX_ENTRY,
    MAGIC,
    MESSAGE_FIELDS,
    MESSAGE_HEAD,
    MESSAGE_RECORD_HEAD,
    RECORD_HEAD,
    ChunkHead,
    Compressor,
)

LIBRARY = f"mwd_surface {__version__}"
REPEAT = 16
_U32 = 0xFFFFFFFF


class McapWriter:
    """
    Writer of one MCAP file.

    Parameters
    ----------
    path : Path
        File to create; it must not exist.
    compression : {"zstd", "lz4", ""}
        Compression of the chunks; "": none.
    chunk_bytes : int
        A chunk is closed when its uncompressed records reach this size.

    Raises
    ------
    ValueError
        The compression is unknown.
    OSError
        Writing fails; every method that writes may raise this. The current chunk then stays in memory and the file ends
        after its last complete record, so that the call may be repeated or the file finished.
    """

    def __init__(self, path: Path, compression: str = "zstd", chunk_bytes: int = 1024 * 1024) -> None:
        self.path = path
        self.chunk_bytes = chunk_bytes
        self.size = 0  #: number of bytes written to the file
        self.counts: dict[int, int] = {}  #: number of messages of each channel, including those in the current chunk
        #: `start_ns`, `end_ns`: first and last log time; start_ns is None, and end_ns 0, without a message.
        self.start_ns: int | None = None
        self.end_ns = 0
        self.channels: dict[int, Channel] = {}
        self._compress = Compressor(compression)
        self._schemas: dict[int, Schema] = {}
        # Kept in encoded form, as in the summary, because an hour of a fast recording has tens of thousands of chunks.
        self._chunk_index: list[bytes] = []
        self._written_ns: tuple[int, int] | None = None
        self._attachment_index: list[bytes] = []
        self._metadata_index: list[bytes] = []
        self._crc = 0
        self._parts: list[bytes] = []
        self._pending = 0
        self._declarations = b""
        self._index: dict[int, list[NDArray[np.void] | tuple[int, int]]] = {}
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        # `is_being_written` tests this lock. On a file system without locks, the file stays unlocked.
        with contextlib.suppress(OSError):
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        try:
            self._append(MAGIC + packed(Header("ros2", LIBRARY)))
        except OSError:
            # A file without content would be in the way of the next attempt.
            os.close(self._file)
            path.unlink()
            raise

    @property
    def messages(self) -> int:
        """Number of messages accepted so far, including those in the current chunk."""
        return sum(self.counts.values())

    def add_schema(self, schema: Schema) -> None:
        """Write a message definition; its id must be new and not 0."""
        record = packed(schema)
        self._append(record)
        self._declarations += record
        self._schemas[schema.id] = schema

    def add_channel(self, channel: Channel) -> None:
        """
        Write the declaration of a topic.

        The id must be new. The schema must have been written before; schema_id 0 means that there is no schema.
        """
        record = packed(channel)
        self._append(record)
        self._declarations += record
        self.channels[channel.id] = channel
        self.counts[channel.id] = 0

    def write(self, channel: int, data: bytes, log_ns: int, publish_ns: int) -> None:
        """Add one message to the current chunk; write the chunk if it is full."""
        self._declare()
        sequence = self.counts[channel] + 1
        head = message_prefix(channel, sequence & _U32, log_ns, publish_ns, len(data))
        self._index.setdefault(channel, []).append((log_ns, self._pending))
        self._parts += (head, data)
        self._pending += len(head) + len(data)
        self._count(channel, 1, log_ns, log_ns)
        if self._pending >= self.chunk_bytes:
            self.close_chunk()

    def write_rows(
        self, channel: int, rows: NDArray[np.uint8], log_ns: NDArray[np.int64], publish_ns: NDArray[np.int64]
    ) -> None:
        """Add many messages of one size, shape (n, size), to chunks; stamps have shape (n,)."""
        count, size = rows.shape
        records = np.empty(count, dtype=[*MESSAGE_FIELDS, ("data", "u1", (size,))])
        records["opcode"] = Opcode.MESSAGE
        records["length"] = MESSAGE_HEAD + size
        records["channel"] = channel
        first = self.counts[channel] + 1
        records["sequence"] = np.arange(first, first + count, dtype=np.int64) & _U32
        records["log_ns"] = log_ns
        records["publish_ns"] = publish_ns
        records["data"] = rows
        offset = np.arange(count) * records.itemsize
        self.write_records(records.view(np.uint8), offset, np.full(count, channel, dtype=np.uint16), log_ns)

    def write_records(
        self,
        records: NDArray[np.uint8],
        offset: NDArray[np.int64],
        channel: NDArray[np.uint16],
        log_ns: NDArray[np.int64],
    ) -> None:
        """
        Add complete message records, one after the other, to the chunks of the file.

        records, uint8: bytes of m records that follow one another. offset, channel, log_ns, shape (m,): start of each
        record in these bytes, its channel and its log time, ns; offset[0] is 0.
        """
        ends = np.append(offset[1:], len(records))
        done = 0
        while done < len(offset):
            self._declare()
            begin = int(offset[done])
            stop = int(np.searchsorted(ends, begin + self.chunk_bytes - self._pending)) + 1
            stop = min(max(stop, done + 1), len(offset))
            part = slice(done, stop)
            for number in np.unique(channel[part]).tolist():
                mine = np.flatnonzero(channel[part] == number) + done
                entries = np.empty(len(mine), dtype=INDEX_ENTRY)
                entries["log_ns"] = log_ns[mine]
                entries["offset"] = self._pending + offset[mine] - begin
                self._index.setdefault(number, []).append(entries)
                self._count(number, len(mine), int(log_ns[mine].min()), int(log_ns[mine].max()))
            end = int(ends[stop - 1])
            self._parts.append(records[begin:end].tobytes())
            self._pending += end - begin
            done = stop
            if self._pending >= self.chunk_bytes:
                self.close_chunk()

    def close_chunk(self) -> None:
        """Write the current chunk, if there is one, and its message indexes."""
        if not self._pending:
            return
        plain = b"".join(self._parts)
        # Keep the joined bytes: if writing fails, the next attempt need not join them again.
        self._parts = [plain]
        indexes = {channel: _entries(items) for channel, items in self._index.items()}
        start = min(int(entries["log_ns"].min()) for entries in indexes.values())
        end = max(int(entries["log_ns"].max()) for entries in indexes.values())
        data = self._compress(plain)
        head = ChunkHead(start, end, len(plain), zlib.crc32(plain), self._compress.compression, len(data), 0)
        self.add_chunk(head, data, indexes)
        self._parts, self._pending, self._index = [], 0, {}

    def add_chunk(self, head: ChunkHead, data: bytes, indexes: Mapping[int, NDArray[np.void]]) -> None:
        """Write a chunk that is already compressed; its messages are not counted here."""
        prefix = chunk_prefix(head)
        offset, length = self.size, len(prefix) + len(data)
        tail, offsets = b"", {}
        for channel, entries in indexes.items():
            offsets[channel] = offset + length + len(tail)
            tail += message_index_record(channel, entries)
        self._append(prefix + data + tail)
        index = ChunkIndex(
            chunk_length=length,
            chunk_start_offset=offset,
            compression=head.compression,
            compressed_size=len(data),
            message_end_time=head.end_ns,
            message_index_length=len(tail),
            message_index_offsets=offsets,
            message_start_time=head.start_ns,
            uncompressed_size=head.size,
        )
        self._chunk_index.append(packed(index))
        start, end = self._written_ns or (head.start_ns, head.end_ns)
        self._written_ns = min(start, head.start_ns), max(end, head.end_ns)

    def copy_chunk(self, head: ChunkHead, data: bytes, indexes: Mapping[int, NDArray[np.void]]) -> None:
        """Write a chunk of another file unchanged, and count its messages by its indexes."""
        self.add_chunk(head, data, indexes)
        for channel, entries in indexes.items():
            self._count(channel, len(entries), int(entries["log_ns"].min()), int(entries["log_ns"].max()))

    def attach(self, item: Attachment) -> None:
        """Store a file inside the recording; the current chunk is closed first."""
        self.close_chunk()
        data, offset = packed(item), self.size
        self._append(data)
        index = AttachmentIndex(
            offset, len(data), item.log_time, item.create_time, len(item.data), item.name, item.media_type
        )
        self._attachment_index.append(packed(index))

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a named table of strings; the current chunk is closed first."""
        self.close_chunk()
        data, offset = packed(Metadata(name, dict(values))), self.size
        self._append(data)
        self._metadata_index.append(packed(MetadataIndex(offset, len(data), name)))

    def sync(self) -> None:
        """Force everything written so far to the disk, except the current chunk."""
        os.fdatasync(self._file)

    def finish(self, sync: bool = False) -> None:
        """Write the current chunk, the summary and the footer, force them to the disk if `sync`, and close the file."""
        self.close_chunk()
        data_end = packed(DataEnd(self._crc))
        self._append(data_end + packed_summary(self._groups(), self.size + len(data_end)))
        if sync:
            os.fsync(self._file)
        self.close()

    def discard_pending(self) -> int:
        """Discard the current chunk because the disk has no room for it; return the number of lost messages."""
        before = self.messages
        for channel, items in self._index.items():
            self.counts[channel] -= len(_entries(items))
        self._parts, self._pending, self._index = [], 0, {}
        self.start_ns, self.end_ns = self._written_ns or (None, 0)
        return before - self.messages

    def deleted(self) -> bool:
        """Return whether the file, which is open, has no name in any folder any more, or cannot be reached."""
        try:
            return os.fstat(self._file).st_nlink == 0
        except OSError:
            return True

    def close(self) -> None:
        """Close the file; unless `finish` was called, the file stays an unfinished recording without an end."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _groups(self) -> list[tuple[Opcode, bytes]]:
        totals = Statistics(
            attachment_count=len(self._attachment_index),
            channel_count=len(self.channels),
            channel_message_counts=dict(sorted(self.counts.items())),
            chunk_count=len(self._chunk_index),
            message_count=self.messages,
            message_end_time=self.end_ns,
            message_start_time=self.start_ns or 0,
            metadata_count=len(self._metadata_index),
            schema_count=len(self._schemas),
        )
        return [
            (Opcode.SCHEMA, b"".join(map(packed, self._schemas.values()))),
            (Opcode.CHANNEL, b"".join(map(packed, self.channels.values()))),
            (Opcode.STATISTICS, packed(totals)),
            (Opcode.CHUNK_INDEX, b"".join(self._chunk_index)),
            (Opcode.ATTACHMENT_INDEX, b"".join(self._attachment_index)),
            (Opcode.METADATA_INDEX, b"".join(self._metadata_index)),
        ]

    def _declare(self) -> None:
        if not self._pending and self._chunk_index and len(self._chunk_index) % REPEAT == 0:
            self._declarations = b"".join(map(packed, self._schemas.values()))
            self._declarations += b"".join(map(packed, self.channels.values()))
        if self._declarations:
            self._parts.append(self._declarations)
            self._pending += len(self._declarations)
            self._declarations = b""

    def _count(self, channel: int, count: int, first_ns: int, last_ns: int) -> None:
        self.counts[channel] += count
        self.start_ns = first_ns if self.start_ns is None else min(self.start_ns, first_ns)
        self.end_ns = max(self.end_ns, last_ns)

    def _append(self, data: bytes) -> None:
        view, written = memoryview(data), 0
        try:
            while written < len(view):
                written += os.write(self._file, view[written:])
        except OSError:
            # Remove the partial record, which would hide everything written after it.
            os.ftruncate(self._file, self.size)
            os.lseek(self._file, self.size, os.SEEK_SET)
            raise
        self._crc = zlib.crc32(data, self._crc)
        self.size += len(data)


def is_being_written(path: Path) -> bool:
    """Return whether a `McapWriter` of any process on this machine has the file, or a file of the folder, open."""
    return any(map(_is_locked, path.glob("*.mcap") if path.is_dir() else [path]))


def _is_locked(path: Path) -> bool:
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    else:
        return False
    finally:
        os.close(handle)


def _entries(items: list[NDArray[np.void] | tuple[int, int]]) -> NDArray[np.void]:
    arrays: list[NDArray[np.void]] = []
    singles: list[tuple[int, int]] = []
    for item in items:
        if isinstance(item, tuple):
            singles.append(item)
            continue
        if singles:
            arrays.append(np.array(singles, dtype=INDEX_ENTRY))
            singles = []
        arrays.append(item)
    if singles:
        arrays.append(np.array(singles, dtype=INDEX_ENTRY))
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


# Encoding of the records of an MCAP file.


def packed(record: McapRecord) -> bytes:
    """Return a record as bytes."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def message_prefix(channel: int, sequence: int, log_ns: int, publish_ns: int, size: int) -> bytes:
    """Return a message record without its payload of `size` bytes."""
    return MESSAGE_RECORD_HEAD.pack(Opcode.MESSAGE, MESSAGE_HEAD + size, channel, sequence, log_ns, publish_ns)


def chunk_prefix(head: ChunkHead) -> bytes:
    """Return a chunk record without its compressed records."""
    name = head.compression.encode()
    fields = (head.start_ns, head.end_ns, head.size, head.crc, len(name), name, head.compressed_size)
    body = struct.pack(f"<QQQII{len(name)}sQ", *fields)
    return RECORD_HEAD.pack(Opcode.CHUNK, len(body) + head.compressed_size) + body


def message_index_record(channel: int, entries: NDArray[np.void]) -> bytes:
    """Return the index of one channel's messages in the preceding chunk; `entries` has the dtype `INDEX_ENTRY`."""
    data = entries.tobytes()
    return struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(data), channel, len(data)) + data


def packed_summary(groups: Sequence[tuple[Opcode, bytes]], start: int) -> bytes:
    """
    Return everything that follows the DataEnd record: summary, summary offsets, footer with CRC, magic bytes.

    groups : (opcode, records of that opcode); groups may be empty.
    start : position of the summary in the file.
    """
    body, offsets, at = b"", b"", start
    for opcode, records in groups:
        if records:
            offsets += packed(SummaryOffset(opcode, at, len(records)))
            at += len(records)
            body += records
    data = body + offsets
    # The CRC is the last field of the footer. It covers the summary, the summary offsets and the rest of the footer.
    foot = packed(Footer(start if data else 0, at if offsets else 0, 0))[:-4]
    return data + foot + zlib.crc32(foot, zlib.crc32(data)).to_bytes(4, "little") + MAGIC
