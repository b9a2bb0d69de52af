# SPDX-License-Identifier: Apache-2.0
"""
Contents of an MCAP file as the reader finds them, and decoding of the bodies of its records.

A length read from a file is compared with the rest of the file or chunk before anything is allocated. Every function
raises FormatError if a field does not fit into the body.
"""

from __future__ import annotations

import dataclasses
import io
import struct
import zlib
from typing import Any, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.records import Attachment, Channel, McapRecord, Metadata, Schema, Statistics

from mwd_surface.bags.mcap.records import COMPRESSIONS, MAX_CHUNK_BYTES, PREFIX, ChunkHead, FormatError
from mwd_surface.bags.mcap.walk import Walk
from mwd_surface.bags.mcap.writer import packed


@dataclasses.dataclass(frozen=True)
class MessageSpan:
    """A contiguous group of messages in a file: one chunk, or messages outside of any chunk."""

    #: `start_ns`, `end_ns`: first and last log time.
    start_ns: int
    end_ns: int
    #: `offset`, `length`: position and length in the file, including the headers of its records.
    offset: int
    length: int
    size: int  #: decompressed size in bytes
    channels: frozenset[int] | None  #: channels with a message in the span; None if unknown
    in_chunk: bool  #: whether the span is a chunk


@dataclasses.dataclass
class Contents:
    """Contents of an MCAP file."""

    #: `schemas`, `channels`, `counts`: by id: schemas, channels, and number of messages of each channel.
    schemas: dict[int, Schema] = dataclasses.field(default_factory=dict)
    channels: dict[int, Channel] = dataclasses.field(default_factory=dict)
    counts: dict[int, int] = dataclasses.field(default_factory=dict)
    spans: list[MessageSpan] = dataclasses.field(default_factory=list)  #: positions and times of the messages
    #: `attachments`, `metadata`: position and length in the file of each record of this kind.
    attachments: list[tuple[int, int]] = dataclasses.field(default_factory=list)
    metadata: list[tuple[int, int]] = dataclasses.field(default_factory=list)
    #: The file has a valid summary or, if it was scanned, its data section has its end and no damage.
    complete: bool = True
    scanned: bool = False  #: the contents were found by scanning the file, not from its summary
    #: Every chunk has a checksum, and no message is outside of a chunk. If the contents come from the summary, only the
    #: first chunk was checked.
    checksums: bool = True
    #: One sentence for each fault or anything unusual that was found.
    notes: list[str] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(frozen=True)
class Chunk:
    """A valid chunk found while scanning."""

    #: `offset`, `length`: position and length of the chunk's record, bytes.
    offset: int
    length: int
    head: ChunkHead
    #: `data`, `plain`: records of the chunk, compressed and decompressed.
    data: bytes
    plain: bytes
    walk: Walk  #: positions of the records in `plain`


@dataclasses.dataclass(frozen=True)
class Bare:
    """Valid messages outside of any chunk."""

    #: `offset`, `length`: position and length of the messages' records, bytes.
    offset: int
    length: int
    plain: bytes  #: records of the messages
    walk: Walk  #: positions of the records in `plain`


@dataclasses.dataclass(frozen=True)
class Other:
    """A record other than message or chunk; only header, schema, channel, attachment and metadata have a `body`."""

    opcode: int
    offset: int
    length: int
    body: bytes


@dataclasses.dataclass(frozen=True)
class Damage:
    """Bytes `offset` to `end` of the file, which could not be read, and the reason."""

    offset: int
    end: int
    reason: str


Piece = Chunk | Bare | Other | Damage


# Decoding of the bodies of records.

# Fixed first part of a chunk index, one entry of its table (channel, position of the message index), length of these
# message indexes and of the name of the compression, and compressed and decompressed size.
_index_head, _index_entry = struct.Struct("<QQQQI"), struct.Struct("<HQ")
_index_tail, _index_sizes = struct.Struct("<QI"), struct.Struct("<QQ")

R = TypeVar("R", bound=McapRecord)


class _Body(ReadDataStream):
    """Stream over the body of a record; it raises FormatError for a field that does not fit into the body."""

    def __init__(self, body: bytes | memoryview) -> None:
        super().__init__(io.BytesIO(body))
        self._size = len(body)

    def read(self, length: int) -> bytes:
        """Return the next `length` bytes."""
        if length > self._size - self.count:
            raise FormatError(f"a field of {length} bytes does not fit into the {self._size - self.count} left")
        return super().read(length)


def parse(kind: type[R], body: bytes | memoryview) -> R:
    """Return the record of a kind in a record's body."""
    reader: Any = kind
    try:
        record: R = reader.read(_Body(body))
    except UnicodeDecodeError as error:
        raise FormatError("a name is not UTF-8") from error
    # `mcap` reads the last entry of a map beyond the length of the map, and keeps one of two entries with equal keys.
    if isinstance(record, Channel | Metadata | Statistics) and not bytes(body).startswith(packed(record)[PREFIX:]):
        raise FormatError("the length of a map does not match its entries, or a key is repeated")
    return record


def parse_attachment(body: bytes | memoryview) -> Attachment:
    """Return the attachment in a record's body; also raise FormatError if its CRC does not match."""
    item = parse(Attachment, body)
    crc = int.from_bytes(body[-4:], "little")
    if crc and zlib.crc32(body[:-4]) != crc:
        raise FormatError(f"attachment {item.name!r}: its checksum does not match")
    return item


def parse_chunk_head(body: bytes | memoryview, length: int) -> ChunkHead:
    """
    Return the header of a chunk.

    body : at least the first bytes of the record's body.
    length : length of the whole body.

    Raises
    ------
    FormatError
        The compression is unknown, the sizes contradict the record's length, or the chunk exceeds `MAX_CHUNK_BYTES`.
    """
    stream = _Body(body)
    start, end, size, crc = stream.read8(), stream.read8(), stream.read8(), stream.read4()
    try:
        compression = stream.read_prefixed_string()
    except UnicodeDecodeError as error:
        raise FormatError("a name is not UTF-8") from error
    compressed = stream.read8()
    if compression not in COMPRESSIONS:
        raise FormatError(f"chunk compression {compression!r} is not one of none, zstd, lz4")
    if size > MAX_CHUNK_BYTES or compressed > MAX_CHUNK_BYTES:
        raise FormatError(f"a chunk of {max(size, compressed)} bytes is above the limit of {MAX_CHUNK_BYTES}")
    if stream.count + compressed > length or (not compression and compressed != size):
        raise FormatError("a chunk's sizes contradict each other")
    return ChunkHead(start, end, size, crc, compression, compressed, stream.count)


def parse_span(body: bytes | memoryview) -> MessageSpan:
    """Return the chunk to which a chunk index points."""
    # The fields are decoded here without `parse`, because a long recording has thousands of these records.
    body = memoryview(body)
    try:
        start, end, offset, length, size = _index_head.unpack_from(body)
        at = _index_head.size + size
        if size % _index_entry.size or at > len(body):
            raise FormatError(f"message indexes of {size} bytes do not fit into the {len(body) - at + size} left")
        channels = frozenset(number for number, _ in _index_entry.iter_unpack(body[_index_head.size : at]))
        indexed, name = _index_tail.unpack_from(body, at)
        _, unpacked = _index_sizes.unpack_from(body, at + _index_tail.size + name)
    except struct.error as error:
        raise FormatError(f"a chunk index of {len(body)} bytes ends early") from error
    return MessageSpan(start, end, offset, length, unpacked, channels if indexed else None, True)
