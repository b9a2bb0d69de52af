# SPDX-License-Identifier: Apache-2.0
"""
Sizes and layouts of the records of an MCAP file that are read and written as bytes; `mcap.records` has the others.

Source: the MCAP specification, version 0.
"""

from __future__ import annotations

import dataclasses
import struct
from typing import Any

import numpy as np

from mwd_sensors.core import budgets

MAGIC = b"\x89MCAP0\r\n"  # first and last bytes of a file


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
class ChunkHead:
    """Header of a chunk; `data_at` is the offset of the (compressed) records of the chunk in the chunk's body."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    compressed_size: int
    data_at: int
