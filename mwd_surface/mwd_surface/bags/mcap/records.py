# SPDX-License-Identifier: Apache-2.0
"""
Sizes and layouts of the records of an MCAP file that are read and written as bytes, and the compression of chunks.

`mcap.records` has the other records. Source: the MCAP specification, version 0.
"""

from __future__ import annotations

import dataclasses
import struct
import zlib
from typing import Any

import lz4.frame
import numpy as np
import zstandard

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


# Compression of chunks.


class Compressor:
    """Compressor of chunks; each thread needs its own, because a compressor keeps a context."""

    def __init__(self, compression: str) -> None:
        if compression not in COMPRESSIONS:
            raise ValueError(f"compression: {compression!r} is not one of '', 'zstd', 'lz4'")
        self.compression = compression
        self._zstd = zstandard.ZstdCompressor(level=1) if compression == "zstd" else None

    def __call__(self, data: bytes) -> bytes:
        """Return the compressed form of `data`."""
        if self._zstd is not None:
            return self._zstd.compress(data)
        return bytes(lz4.frame.compress(data)) if self.compression == "lz4" else data


class Decompressor:
    """Decompressor that checks chunks and allocates at most their declared size; each thread needs its own."""

    def __init__(self) -> None:
        self._zstd = zstandard.ZstdDecompressor()

    def __call__(self, head: ChunkHead, data: bytes | memoryview) -> bytes:
        """
        Return the records of a chunk, decompressed.

        Raises FormatError if the data does not decompress to exactly the declared size, or the chunk's CRC
        does not match.
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
            # The size in the zstd frame decides how much is allocated, so compare it with the chunk's size first.
            declared = zstandard.frame_content_size(data)
            if declared not in (-1, head.size):
                raise FormatError(f"a chunk's zstd frame holds {declared} bytes instead of {head.size}")
            return self._zstd.decompress(data, max_output_size=head.size)
        if head.compression == "lz4":
            unpacker = lz4.frame.LZ4FrameDecompressor()
            plain = bytes(unpacker.decompress(bytes(data), max_length=head.size + 1))
            # Refuse a frame whose end mark is damaged, as other readers do.
            if len(plain) <= head.size and not unpacker.eof:
                raise FormatError("a chunk's lz4 frame is not complete")
            return plain
        return bytes(data)
