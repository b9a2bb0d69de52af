# SPDX-License-Identifier: Apache-2.0
"""Contents of an MCAP file, and the pieces found while scanning it."""

from __future__ import annotations

import dataclasses

from mcap.records import Channel, Schema

from mwd_surface.bags.mcap.records import ChunkHead
from mwd_surface.bags.mcap.walk import Walk


@dataclasses.dataclass(frozen=True)
class MessageSpan:
    """
    A contiguous group of messages in a file: one chunk, or messages outside of any chunk.

    Attributes
    ----------
    start_ns, end_ns : int
        First and last log time.
    offset, length : int
        Position and length in the file, including the headers of its records.
    size : int
        Decompressed size in bytes.
    channels : frozenset of int, optional
        Channels with a message in the span; None if unknown.
    in_chunk : bool
        Whether the span is a chunk.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    size: int
    channels: frozenset[int] | None
    in_chunk: bool


@dataclasses.dataclass
class Contents:
    """
    Contents of an MCAP file.

    Attributes
    ----------
    schemas, channels, counts : dict
        By id: schemas, channels, and number of messages of each channel.
    spans : list of MessageSpan
        Positions and times of the messages.
    attachments, metadata : list of (int, int)
        Position and length in the file of each record of this kind.
    complete : bool
        The file has a valid summary or, if it was scanned, its data section has its end and no damage.
    scanned : bool
        The contents were found by scanning the file, not from its summary.
    checksums : bool
        Every chunk has a checksum, and no message is outside of a chunk. If the contents come from the summary, only
        the first chunk was checked.
    notes : list of str
        One sentence for each fault or anything unusual that was found.
    """

    schemas: dict[int, Schema] = dataclasses.field(default_factory=dict)
    channels: dict[int, Channel] = dataclasses.field(default_factory=dict)
    counts: dict[int, int] = dataclasses.field(default_factory=dict)
    spans: list[MessageSpan] = dataclasses.field(default_factory=list)
    attachments: list[tuple[int, int]] = dataclasses.field(default_factory=list)
    metadata: list[tuple[int, int]] = dataclasses.field(default_factory=list)
    complete: bool = True
    scanned: bool = False
    checksums: bool = True
    notes: list[str] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(frozen=True)
class Chunk:
    """
    A valid chunk found while scanning.

    offset, length : position and length of the chunk's record, bytes.
    data, plain : records of the chunk, compressed and decompressed.
    walk : positions of the records in `plain`.
    """

    offset: int
    length: int
    head: ChunkHead
    data: bytes
    plain: bytes
    walk: Walk


@dataclasses.dataclass(frozen=True)
class Bare:
    """
    Valid messages outside of any chunk.

    offset, length : position and length of the messages' records, bytes.
    plain : these records.
    walk : positions of the records in `plain`.
    """

    offset: int
    length: int
    plain: bytes
    walk: Walk


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
