"""
The bytes of an MCAP container: records written, read back within bounds, and walked at the speed of the machine.

Source: the MCAP specification, version 0 (records, opcodes, CRC-32 of the uncompressed chunk). A length found in a
file is never believed: it is compared with what is left of the file or chunk before anything is allocated.
"""

from __future__ import annotations

import dataclasses
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Bytes
from mwd_sensors.core.compiled import HAVE_NUMBA, compiled

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(9, 16)

PREFIX = 9  # opcode, length
MESSAGE_HEAD = 22  # channel, sequence, log time, publish time
MESSAGE_PREFIX = PREFIX + MESSAGE_HEAD
FOOTER_BYTES = PREFIX + 20
# A chunk larger than this is refused: one hostile length must not take the memory of the machine.
MAX_CHUNK_BYTES = 128 * 1024 * 1024
COMPRESSIONS = ("", "zstd", "lz4")

_record = struct.Struct("<BQ")
_message = struct.Struct("<BQHIQQ")
_index_head, _index_entry = struct.Struct("<QQQQI"), struct.Struct("<HQ")
_u16, _u32, _u64 = struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<Q")

# A message record as the bulk writer lays it out; the payload's size completes it.
MESSAGE_FIELDS: list[tuple[Any, ...]] = [
    ("opcode", "u1"),
    ("length", "<u8"),
    ("channel", "<u2"),
    ("sequence", "<u4"),
    ("log_ns", "<u8"),
    ("publish_ns", "<u8"),
]
INDEX_ENTRY = np.dtype([("log_ns", "<u8"), ("offset", "<u8")])


class FormatError(ValueError):
    """Bytes that are not what the container promises; the message says what and where."""


@dataclasses.dataclass(frozen=True)
class Schema:
    """Definition of a message type; the encoding of ROS 2 definitions is ``ros2msg`` or ``ros2idl``."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclasses.dataclass(frozen=True)
class Channel:
    """One topic of one type in one file."""

    id: int
    schema_id: int
    topic: str
    encoding: str
    metadata: Mapping[str, str]


@dataclasses.dataclass(frozen=True)
class ChunkHead:
    """What a chunk says of itself before its (compressed) records; `data_at` counts from the record's body."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    compressed_size: int
    data_at: int


@dataclasses.dataclass(frozen=True)
class ChunkIndex:
    """Where a chunk and its message indexes lie in the file."""

    start_ns: int
    end_ns: int
    offset: int
    length: int
    index_offsets: Mapping[int, int]
    index_length: int
    compression: str
    compressed_size: int
    size: int


@dataclasses.dataclass(frozen=True)
class Attachment:
    """A file kept inside the recording."""

    log_ns: int
    create_ns: int
    name: str
    media_type: str
    data: bytes


@dataclasses.dataclass(frozen=True)
class Statistics:
    """Totals in the summary."""

    messages: int
    schemas: int
    channels: int
    attachments: int
    metadata: int
    chunks: int
    start_ns: int
    end_ns: int
    counts: Mapping[int, int]


def record(opcode: int, body: bytes) -> bytes:
    """One record: opcode, length, body."""
    return _record.pack(opcode, len(body)) + body


def text(value: str) -> bytes:
    """A string with its length."""
    data = value.encode()
    return _u32.pack(len(data)) + data


def text_map(values: Mapping[str, str]) -> bytes:
    """A map of strings with its length in bytes."""
    body = b"".join(text(key) + text(value) for key, value in values.items())
    return _u32.pack(len(body)) + body


def header_record(library: str) -> bytes:
    """Header of a ROS 2 recording."""
    return record(HEADER, text("ros2") + text(library))


def schema_record(schema: Schema) -> bytes:
    """Definition of a type."""
    body = _u16.pack(schema.id) + text(schema.name) + text(schema.encoding) + _u32.pack(len(schema.data)) + schema.data
    return record(SCHEMA, body)


def channel_record(channel: Channel) -> bytes:
    """Declaration of a topic."""
    body = struct.pack("<HH", channel.id, channel.schema_id) + text(channel.topic) + text(channel.encoding)
    return record(CHANNEL, body + text_map(channel.metadata))


def message_prefix(channel: int, sequence: int, log_ns: int, publish_ns: int, size: int) -> bytes:
    """All of a message record but its payload of `size` bytes."""
    return _message.pack(MESSAGE, MESSAGE_HEAD + size, channel, sequence, log_ns, publish_ns)


def chunk_prefix(head: ChunkHead) -> bytes:
    """All of a chunk record but its compressed records."""
    body = struct.pack("<QQQI", head.start_ns, head.end_ns, head.size, head.crc)
    body += text(head.compression) + _u64.pack(head.compressed_size)
    return _record.pack(CHUNK, len(body) + head.compressed_size) + body


def message_index_record(channel: int, entries: NDArray[np.void]) -> bytes:
    """Index of one channel's messages in the chunk before it; entries of dtype `INDEX_ENTRY`."""
    data = entries.tobytes()
    return record(MESSAGE_INDEX, struct.pack("<HI", channel, len(data)) + data)


def chunk_index_record(index: ChunkIndex) -> bytes:
    """Summary's pointer to a chunk."""
    offsets = b"".join(struct.pack("<HQ", channel, at) for channel, at in index.index_offsets.items())
    body = struct.pack("<QQQQ", index.start_ns, index.end_ns, index.offset, index.length)
    body += _u32.pack(len(offsets)) + offsets + _u64.pack(index.index_length)
    return record(CHUNK_INDEX, body + text(index.compression) + struct.pack("<QQ", index.compressed_size, index.size))


def attachment_record(item: Attachment) -> bytes:
    """A file inside the recording, with its CRC."""
    body = struct.pack("<QQ", item.log_ns, item.create_ns) + text(item.name) + text(item.media_type)
    body += _u64.pack(len(item.data)) + item.data
    return record(ATTACHMENT, body + _u32.pack(zlib.crc32(body)))


def attachment_index_record(item: Attachment, offset: int, length: int) -> bytes:
    """Summary's pointer to an attachment."""
    body = struct.pack("<QQQQQ", offset, length, item.log_ns, item.create_ns, len(item.data))
    return record(ATTACHMENT_INDEX, body + text(item.name) + text(item.media_type))


def metadata_record(name: str, values: Mapping[str, str]) -> bytes:
    """Named table of strings."""
    return record(METADATA, text(name) + text_map(values))


def metadata_index_record(name: str, offset: int, length: int) -> bytes:
    """Summary's pointer to a table."""
    return record(METADATA_INDEX, struct.pack("<QQ", offset, length) + text(name))


def statistics_record(totals: Statistics) -> bytes:
    """Totals of the file."""
    counts = b"".join(struct.pack("<HQ", channel, count) for channel, count in sorted(totals.counts.items()))
    body = struct.pack(
        "<QHIIIIQQ",
        totals.messages,
        totals.schemas,
        totals.channels,
        totals.attachments,
        totals.metadata,
        totals.chunks,
        totals.start_ns,
        totals.end_ns,
    )
    return record(STATISTICS, body + _u32.pack(len(counts)) + counts)


def summary(groups: Sequence[tuple[int, bytes]], start: int) -> bytes:
    """
    Everything after DataEnd: summary, its offsets, footer with CRC, magic.

    groups : (opcode, records of that opcode), empty groups allowed. start : where in the file the summary begins.
    """
    body, offsets, at = b"", b"", start
    for opcode, records in groups:
        if records:
            offsets += record(SUMMARY_OFFSET, struct.pack("<BQQ", opcode, at, len(records)))
            at += len(records)
            body += records
    data = body + offsets
    foot = _record.pack(FOOTER, 20) + struct.pack("<QQ", start if data else 0, at if offsets else 0)
    return data + foot + _u32.pack(zlib.crc32(foot, zlib.crc32(data))) + MAGIC


class Cursor:
    """Reads fields one after another from a record's body; past its end it raises FormatError."""

    def __init__(self, data: bytes | memoryview) -> None:
        self.data = memoryview(data)
        self.at = 0

    def take(self, size: int) -> memoryview:
        """Next `size` bytes."""
        if size < 0 or self.at + size > len(self.data):
            raise FormatError(f"a field of {size} bytes does not fit into the {len(self.data) - self.at} left")
        part = self.data[self.at : self.at + size]
        self.at += size
        return part

    def number(self, size: int) -> int:
        """Unsigned little-endian integer of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def blob(self, length_bytes: int = 4) -> bytes:
        """Bytes with their length."""
        return bytes(self.take(self.number(length_bytes)))

    def text(self) -> str:
        """A string with its length."""
        try:
            return self.blob().decode()
        except UnicodeDecodeError as error:
            raise FormatError("a name is not UTF-8") from error

    def text_map(self) -> dict[str, str]:
        """A map of strings with its length in bytes."""
        inner = Cursor(self.blob())
        values = {}
        while inner.at < len(inner.data):
            key = inner.text()
            values[key] = inner.text()
        return values


def parse_schema(body: bytes | memoryview) -> Schema:
    """Schema of a record's body."""
    cursor = Cursor(body)
    return Schema(cursor.number(2), cursor.text(), cursor.text(), cursor.blob())


def parse_channel(body: bytes | memoryview) -> Channel:
    """Channel of a record's body."""
    cursor = Cursor(body)
    return Channel(cursor.number(2), cursor.number(2), cursor.text(), cursor.text(), cursor.text_map())


def parse_chunk_head(body: bytes | memoryview, length: int) -> ChunkHead:
    """
    What a chunk says of itself.

    body : at least the first bytes of the record's body; length : that of the whole body.

    Raises
    ------
    FormatError
        Unknown compression, sizes that contradict the record's length, or a chunk above `MAX_CHUNK_BYTES`.
    """
    cursor = Cursor(body)
    start, end, size, crc = cursor.number(8), cursor.number(8), cursor.number(8), cursor.number(4)
    compression = cursor.text()
    compressed = cursor.number(8)
    if compression not in COMPRESSIONS:
        raise FormatError(f"chunk compression {compression!r} is not one of none, zstd, lz4")
    if size > MAX_CHUNK_BYTES or compressed > MAX_CHUNK_BYTES:
        raise FormatError(f"a chunk of {max(size, compressed)} bytes is above the limit of {MAX_CHUNK_BYTES}")
    if cursor.at + compressed > length or (not compression and compressed != size):
        raise FormatError("a chunk's sizes contradict each other")
    return ChunkHead(start, end, size, crc, compression, compressed, cursor.at)


def parse_chunk_index(body: bytes | memoryview) -> ChunkIndex:
    """Chunk index of a record's body."""
    # Written out, because a long recording has thousands of them.
    body = memoryview(body)
    try:
        start, end, offset, length, size = _index_head.unpack_from(body)
        at = _index_head.size
        if size % _index_entry.size or at + size > len(body):
            raise FormatError(f"message indexes of {size} bytes do not fit into the {len(body) - at} left")
        offsets = dict(_index_entry.iter_unpack(body[at : at + size]))
    except struct.error as error:
        raise FormatError(f"a chunk index of {len(body)} bytes ends early") from error
    cursor = Cursor(body)
    cursor.at = at + size
    return ChunkIndex(
        start,
        end,
        offset,
        length,
        offsets,
        cursor.number(8),
        cursor.text(),
        cursor.number(8),
        cursor.number(8),
    )


def parse_attachment(body: bytes | memoryview) -> Attachment:
    """
    Attachment of a record's body.

    Raises
    ------
    FormatError
        The CRC does not match.
    """
    cursor = Cursor(body)
    item = Attachment(cursor.number(8), cursor.number(8), cursor.text(), cursor.text(), cursor.blob(8))
    end = cursor.at
    crc = cursor.number(4)
    if crc and zlib.crc32(cursor.data[:end]) != crc:
        raise FormatError(f"attachment {item.name!r}: its checksum does not match")
    return item


def parse_metadata(body: bytes | memoryview) -> tuple[str, dict[str, str]]:
    """Name and table of a metadata record's body."""
    cursor = Cursor(body)
    return cursor.text(), cursor.text_map()


def parse_statistics(body: bytes | memoryview) -> Statistics:
    """Totals of a record's body."""
    cursor = Cursor(body)
    numbers = struct.unpack("<QHIIIIQQ", cursor.take(42))
    inner = Cursor(cursor.blob())
    counts = {}
    while inner.at < len(inner.data):
        channel = inner.number(2)
        counts[channel] = inner.number(8)
    messages, schemas, channels, attachments, metadata, chunks, start, end = numbers
    return Statistics(messages, schemas, channels, attachments, metadata, chunks, start, end, counts)


class Compressor:
    """Compresses chunks; keeps its context, so one per thread."""

    def __init__(self, compression: str = "zstd", level: int = 1) -> None:
        if compression not in COMPRESSIONS:
            raise ValueError(f"compression: {compression!r} is not one of '', 'zstd', 'lz4'")
        self.compression = compression
        self._zstd = zstandard.ZstdCompressor(level=level) if compression == "zstd" else None

    def __call__(self, data: bytes) -> bytes:
        """Compressed form of `data`."""
        if self._zstd is not None:
            return self._zstd.compress(data)
        return bytes(lz4.frame.compress(data)) if self.compression == "lz4" else data


class Decompressor:
    """Decompresses and checks chunks in memory bounded by their declared size; one per thread."""

    def __init__(self) -> None:
        self._zstd = zstandard.ZstdDecompressor()

    def __call__(self, head: ChunkHead, data: bytes | memoryview) -> bytes:
        """
        Records of a chunk.

        Raises
        ------
        FormatError
            The data does not decompress to exactly the declared size, or its CRC is wrong.
        """
        try:
            plain = self._plain(head, data)
        except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
            raise FormatError(f"a chunk does not decompress: {error}") from error
        if len(plain) != head.size:
            raise FormatError(f"a chunk decompressed to {len(plain)} bytes instead of {head.size}")
        if head.crc and zlib.crc32(plain) != head.crc:
            raise FormatError("a chunk's checksum does not match")
        return plain

    def _plain(self, head: ChunkHead, data: bytes | memoryview) -> bytes:
        if head.compression == "zstd":
            # The frame's own size decides what is allocated, so it has to agree first.
            declared = zstandard.frame_content_size(data)
            if declared not in (-1, head.size):
                raise FormatError(f"a chunk's zstd frame holds {declared} bytes instead of {head.size}")
            return self._zstd.decompress(data, max_output_size=head.size)
        if head.compression == "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(bytes(data), max_length=head.size + 1))
        return bytes(data)


@dataclasses.dataclass(frozen=True)
class Walk:
    """
    Records found by walking a run of bytes.

    Attributes
    ----------
    offset, size : shape (n,), int64
        Where each message's payload begins, and its bytes.
    channel : shape (n,), uint16
    log_ns, publish_ns : shape (n,), int64
    others : shape (m,), int64
        Where each record that is not a message begins.
    end : int
        First byte not understood; the length of the data when all of it was.
    """

    offset: NDArray[np.int64]
    size: NDArray[np.int64]
    channel: NDArray[np.uint16]
    log_ns: NDArray[np.int64]
    publish_ns: NDArray[np.int64]
    others: NDArray[np.int64]
    end: int


@compiled
def _number(data: Any, at: int) -> int:
    value = np.int64(0)
    for k in range(8):
        value |= np.int64(data[at + k]) << np.int64(8 * k)
    return value  # type: ignore[return-value]


@compiled
def _walk(  # one flat loop on purpose: it runs once per message of a bag
    data: Any, offset: Any, size: Any, channel: Any, log_ns: Any, publish_ns: Any, others: Any
) -> tuple[int, int, int]:
    at, count, other = 0, 0, 0
    end = len(data)
    while at + 9 <= end:
        length = _number(data, at + 1)
        if length < 0 or length > end - at - 9:
            break
        if data[at] == 5:
            if length < 22:
                break
            channel[count] = np.uint16(data[at + 9]) | (np.uint16(data[at + 10]) << np.uint16(8))
            log_ns[count] = _number(data, at + 15)
            publish_ns[count] = _number(data, at + 23)
            offset[count] = at + 31
            size[count] = length - 22
            count += 1
        else:
            if other == len(others):
                break
            others[other] = at
            other += 1
        at += 9 + length
    return count, other, at


def walk_compiled(data: Bytes) -> Walk:
    """`walk` by the compiled loop."""
    room = len(data) // MESSAGE_PREFIX + 1
    offset, size, log_ns, publish_ns = (np.empty(room, dtype=np.int64) for _ in range(4))
    channel = np.empty(room, dtype=np.uint16)
    others = np.empty(len(data) // PREFIX + 1, dtype=np.int64)
    n, m, end = _walk(data, offset, size, channel, log_ns, publish_ns, others)
    return Walk(
        offset[:n].copy(),
        size[:n].copy(),
        channel[:n].copy(),
        log_ns[:n].copy(),
        publish_ns[:n].copy(),
        others[:m].copy(),
        end,
    )


def walk_plain(data: Bytes) -> Walk:
    """`walk` where numba is absent."""
    view, end, at = data.tobytes(), len(data), 0
    rows: list[tuple[int, int, int, int, int]] = []
    others: list[int] = []
    while at + PREFIX <= end:
        opcode, length = _record.unpack_from(view, at)
        if length > end - at - PREFIX:
            break
        if opcode == MESSAGE:
            if length < MESSAGE_HEAD:
                break
            _, _, channel, _, log_ns, publish_ns = _message.unpack_from(view, at)
            rows.append((at + MESSAGE_PREFIX, length - MESSAGE_HEAD, channel, log_ns, publish_ns))
        else:
            others.append(at)
        at += PREFIX + length
    table = np.array(rows, dtype=np.uint64).reshape(len(rows), 5).astype(np.int64)
    return Walk(
        table[:, 0],
        table[:, 1],
        table[:, 2].astype(np.uint16),
        table[:, 3],
        table[:, 4],
        np.array(others, dtype=np.int64),
        at,
    )


def walk(data: Bytes) -> Walk:
    """Find the records in a run of bytes, shape (n,), uint8; stops at the first that does not fit, never raises."""
    return walk_compiled(data) if HAVE_NUMBA else walk_plain(data)


def records_of(data: Bytes, offsets: NDArray[np.int64]) -> list[tuple[int, memoryview]]:
    """(opcode, body) of the records beginning at the offsets that `walk` found."""
    view = memoryview(data)  # type: ignore[arg-type]
    found = []
    for at in offsets.tolist():
        opcode, length = _record.unpack_from(view, at)
        found.append((opcode, view[at + PREFIX : at + PREFIX + length]))
    return found
