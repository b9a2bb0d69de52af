# SPDX-License-Identifier: Apache-2.0
"""
Records of an MCAP file: opcodes, sizes and fields of each kind.

Source: the MCAP specification, version 0.
"""

from __future__ import annotations

import dataclasses
import enum
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from mwd_sensors.core import budgets

MAGIC = b"\x89MCAP0\r\n"  # first and last bytes of a file


class Opcode(enum.IntEnum):
    """First byte of a record."""

    HEADER = 1
    FOOTER = 2
    SCHEMA = 3
    CHANNEL = 4
    MESSAGE = 5
    CHUNK = 6
    MESSAGE_INDEX = 7
    CHUNK_INDEX = 8
    ATTACHMENT = 9
    ATTACHMENT_INDEX = 10
    STATISTICS = 11
    METADATA = 12
    METADATA_INDEX = 13
    SUMMARY_OFFSET = 14
    DATA_END = 15


# Sizes, bytes: opcode and length of a record; channel, sequence, log time and publish time of a message.
PREFIX = 9
MESSAGE_HEAD = 22
MESSAGE_PREFIX = PREFIX + MESSAGE_HEAD
FOOTER_BYTES = PREFIX + 20
# Largest size of a chunk, bytes. Larger chunks are refused, so that one forged length cannot exhaust the memory.
MAX_CHUNK_BYTES = budgets.MCAP.unpacked or 0
COMPRESSIONS = ("", "zstd", "lz4")
# Layout of a message record in the bulk writer; the payload follows these fields.
MESSAGE_FIELDS: list[tuple[Any, ...]] = [
    ("opcode", "u1"),
    ("length", "<u8"),
    ("channel", "<u2"),
    ("sequence", "<u4"),
    ("log_ns", "<u8"),
    ("publish_ns", "<u8"),
]
INDEX_ENTRY = np.dtype([("log_ns", "<u8"), ("offset", "<u8")])
RECORD_HEAD = struct.Struct("<BQ")
MESSAGE_RECORD_HEAD = struct.Struct("<BQHIQQ")


class FormatError(ValueError):
    """Raised if bytes do not follow the MCAP format; the message describes the fault and its position."""


@dataclasses.dataclass(frozen=True)
class Schema:
    """Definition of a message type; the encoding of ROS 2 definitions is ``ros2msg`` or ``ros2idl``."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclasses.dataclass(frozen=True)
class McapChannel:
    """One topic of one type in one file."""

    id: int
    schema_id: int
    topic: str
    encoding: str
    metadata: Mapping[str, str]


@dataclasses.dataclass(frozen=True)
class ChunkHead:
    """Header of a chunk; `data_at` is the offset of the (compressed) records of the chunk in the chunk's body."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    compressed_size: int
    data_at: int


@dataclasses.dataclass(frozen=True)
class ChunkIndex:
    """Times, sizes and position of a chunk, and by channel the positions of its message indexes in the file."""

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
    """A file stored inside the recording; log_ns and create_ns are its log time and creation time, ns since 1970."""

    log_ns: int
    create_ns: int
    name: str
    media_type: str
    data: bytes


@dataclasses.dataclass(frozen=True)
class Statistics:
    """Totals in the summary: numbers of records, time span in ns, and number of messages of each channel."""

    messages: int
    schemas: int
    channels: int
    attachments: int
    metadata: int
    chunks: int
    start_ns: int
    end_ns: int
    counts: Mapping[int, int]
