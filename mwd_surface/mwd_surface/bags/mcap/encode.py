# SPDX-License-Identifier: Apache-2.0
"""
Encoding of the records of an MCAP file.

Source: the MCAP specification, version 0 (records, opcodes, CRC-32 of the uncompressed chunk).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mwd_surface.bags.mcap.records import (
    MAGIC,
    MESSAGE_HEAD,
    MESSAGE_RECORD_HEAD,
    RECORD_HEAD,
    Attachment,
    Channel,
    ChunkHead,
    ChunkIndex,
    Opcode,
    Schema,
    Statistics,
)

_u16, _u32, _u64 = struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<Q")


def packed_record(opcode: int, body: bytes) -> bytes:
    """Return one record: opcode, length, body."""
    return RECORD_HEAD.pack(opcode, len(body)) + body


def packed_text(value: str) -> bytes:
    """Return a string preceded by its length."""
    data = value.encode()
    return _u32.pack(len(data)) + data


def packed_map(values: Mapping[str, str]) -> bytes:
    """Return a map of strings preceded by its length in bytes."""
    body = b"".join(packed_text(key) + packed_text(value) for key, value in values.items())
    return _u32.pack(len(body)) + body


def header_record(library: str) -> bytes:
    """Return the header record of a ROS 2 recording."""
    return packed_record(Opcode.HEADER, packed_text("ros2") + packed_text(library))


def schema_record(schema: Schema) -> bytes:
    """Return the record that defines a message type."""
    body = (
        _u16.pack(schema.id)
        + packed_text(schema.name)
        + packed_text(schema.encoding)
        + _u32.pack(len(schema.data))
        + schema.data
    )
    return packed_record(Opcode.SCHEMA, body)


def channel_record(channel: Channel) -> bytes:
    """Return the record that declares a topic."""
    body = (
        struct.pack("<HH", channel.id, channel.schema_id) + packed_text(channel.topic) + packed_text(channel.encoding)
    )
    return packed_record(Opcode.CHANNEL, body + packed_map(channel.metadata))


def message_prefix(channel: int, sequence: int, log_ns: int, publish_ns: int, size: int) -> bytes:
    """Return a message record without its payload of `size` bytes."""
    return MESSAGE_RECORD_HEAD.pack(Opcode.MESSAGE, MESSAGE_HEAD + size, channel, sequence, log_ns, publish_ns)


def chunk_prefix(head: ChunkHead) -> bytes:
    """Return a chunk record without its compressed records."""
    body = struct.pack("<QQQI", head.start_ns, head.end_ns, head.size, head.crc)
    body += packed_text(head.compression) + _u64.pack(head.compressed_size)
    return RECORD_HEAD.pack(Opcode.CHUNK, len(body) + head.compressed_size) + body


def message_index_record(channel: int, entries: NDArray[np.void]) -> bytes:
    """Return the index of one channel's messages in the preceding chunk; `entries` has the dtype `INDEX_ENTRY`."""
    data = entries.tobytes()
    return packed_record(Opcode.MESSAGE_INDEX, struct.pack("<HI", channel, len(data)) + data)


def chunk_index_record(index: ChunkIndex) -> bytes:
    """Return the summary record that points to a chunk."""
    offsets = b"".join(struct.pack("<HQ", channel, at) for channel, at in index.index_offsets.items())
    body = struct.pack("<QQQQ", index.start_ns, index.end_ns, index.offset, index.length)
    body += _u32.pack(len(offsets)) + offsets + _u64.pack(index.index_length)
    return packed_record(
        Opcode.CHUNK_INDEX,
        body + packed_text(index.compression) + struct.pack("<QQ", index.compressed_size, index.size),
    )


def attachment_record(item: Attachment) -> bytes:
    """Return the record of an attached file, with its CRC."""
    body = struct.pack("<QQ", item.log_ns, item.create_ns) + packed_text(item.name) + packed_text(item.media_type)
    body += _u64.pack(len(item.data)) + item.data
    return packed_record(Opcode.ATTACHMENT, body + _u32.pack(zlib.crc32(body)))


def attachment_index_record(item: Attachment, offset: int, length: int) -> bytes:
    """Return the summary record that points to an attachment."""
    body = struct.pack("<QQQQQ", offset, length, item.log_ns, item.create_ns, len(item.data))
    return packed_record(Opcode.ATTACHMENT_INDEX, body + packed_text(item.name) + packed_text(item.media_type))


def metadata_record(name: str, values: Mapping[str, str]) -> bytes:
    """Return the record of a named table of strings."""
    return packed_record(Opcode.METADATA, packed_text(name) + packed_map(values))


def metadata_index_record(name: str, offset: int, length: int) -> bytes:
    """Return the summary record that points to a table."""
    return packed_record(Opcode.METADATA_INDEX, struct.pack("<QQ", offset, length) + packed_text(name))


def statistics_record(totals: Statistics) -> bytes:
    """Return the record with the totals of the file."""
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
    return packed_record(Opcode.STATISTICS, body + _u32.pack(len(counts)) + counts)


def packed_summary(groups: Sequence[tuple[int, bytes]], start: int) -> bytes:
    """
    Return everything that follows the DataEnd record: summary, summary offsets, footer with CRC, magic bytes.

    groups : (opcode, records of that opcode); groups may be empty. start : position of the summary in the file.
    """
    body, offsets, at = b"", b"", start
    for opcode, records in groups:
        if records:
            offsets += packed_record(Opcode.SUMMARY_OFFSET, struct.pack("<BQQ", opcode, at, len(records)))
            at += len(records)
            body += records
    data = body + offsets
    foot = RECORD_HEAD.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", start if data else 0, at if offsets else 0)
    return data + foot + _u32.pack(zlib.crc32(foot, zlib.crc32(data))) + MAGIC
