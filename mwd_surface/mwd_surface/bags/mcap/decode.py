# SPDX-License-Identifier: Apache-2.0
"""
Decoding of the bodies of records of an MCAP file.

A length read from a file is compared with the rest of the file or chunk before anything is allocated. Every function
raises FormatError if a field does not fit into the body.
"""

from __future__ import annotations

import io
import struct
import zlib
from typing import Any, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.records import Attachment, Channel, McapRecord, Metadata, Statistics

from mwd_surface.bags.mcap.contents import MessageSpan
from mwd_surface.bags.mcap.records import COMPRESSIONS, MAX_CHUNK_BYTES, PREFIX, ChunkHead, FormatError
from mwd_surface.bags.mcap.writer import packed

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
