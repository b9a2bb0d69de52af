# SPDX-License-Identifier: Apache-2.0
"""
Decoding of the bodies of records of an MCAP file.

A length read from a file is compared with the rest of the file or chunk before anything is allocated. Every function
raises FormatError if a field does not fit into the body.
"""

from __future__ import annotations

import struct
import zlib

from mwd_surface.bags.mcap.records import (
    COMPRESSIONS,
    MAX_CHUNK_BYTES,
    Attachment,
    ChunkHead,
    ChunkIndex,
    FormatError,
    McapChannel,
    Schema,
    Statistics,
)

# Fixed first part of a chunk index, and one entry of its table: channel, position of the message index.
_index_head, _index_entry = struct.Struct("<QQQQI"), struct.Struct("<HQ")


class Cursor:
    """Reader of the fields of a record's body, one after another; it raises FormatError at the end of the body."""

    def __init__(self, data: bytes | memoryview) -> None:
        self.data = memoryview(data)
        self.at = 0

    def take(self, size: int) -> memoryview:
        """Return the next `size` bytes; raise FormatError if there are fewer."""
        if size < 0 or self.at + size > len(self.data):
            raise FormatError(f"a field of {size} bytes does not fit into the {len(self.data) - self.at} left")
        part = self.data[self.at : self.at + size]
        self.at += size
        return part

    def number(self, size: int) -> int:
        """Return an unsigned little-endian integer of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def blob(self, length_bytes: int = 4) -> bytes:
        """Return bytes that are preceded by their length."""
        return bytes(self.take(self.number(length_bytes)))

    def text(self) -> str:
        """Return a string that is preceded by its length; raise FormatError if it is not UTF-8."""
        try:
            return self.blob().decode()
        except UnicodeDecodeError as error:
            raise FormatError("a name is not UTF-8") from error

    def text_map(self) -> dict[str, str]:
        """Return a map of strings that is preceded by its length in bytes."""
        inner = Cursor(self.blob())
        values = {}
        while inner.at < len(inner.data):
            key = inner.text()
            values[key] = inner.text()
        return values


def parse_schema(body: bytes | memoryview) -> Schema:
    """Return the schema in a record's body."""
    cursor = Cursor(body)
    return Schema(cursor.number(2), cursor.text(), cursor.text(), cursor.blob())


def parse_channel(body: bytes | memoryview) -> McapChannel:
    """Return the channel in a record's body."""
    cursor = Cursor(body)
    return McapChannel(cursor.number(2), cursor.number(2), cursor.text(), cursor.text(), cursor.text_map())


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
    """Return the chunk index in a record's body; raise FormatError if the body ends early."""
    # The fields are decoded here without `Cursor`, because a long recording has thousands of these records.
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
    Return the attachment in a record's body.

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
    """Return the name and the table in a metadata record's body."""
    cursor = Cursor(body)
    return cursor.text(), cursor.text_map()


def parse_statistics(body: bytes | memoryview) -> Statistics:
    """Return the statistics in a record's body."""
    cursor = Cursor(body)
    numbers = struct.unpack("<QHIIIIQQ", cursor.take(42))
    inner = Cursor(cursor.blob())
    counts = {}
    while inner.at < len(inner.data):
        channel = inner.number(2)
        counts[channel] = inner.number(8)
    messages, schemas, channels, attachments, metadata, chunks, start, end = numbers
    return Statistics(messages, schemas, channels, attachments, metadata, chunks, start, end, counts)
