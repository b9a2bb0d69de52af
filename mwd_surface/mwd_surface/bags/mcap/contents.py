# SPDX-License-Identifier: Apache-2.0
"""Contents of an MCAP file, and the pieces met while reading it through."""

from __future__ import annotations

import dataclasses

from mwd_surface.bags.mcap.records import (
    Channel,
    ChunkHead,
    Schema,
)
from mwd_surface.bags.mcap.walk import Walk


@dataclasses.dataclass(frozen=True)
class Span:
    """
    A run of messages: one chunk, or messages outside of any chunk.

    Attributes
    ----------
    start_ns, end_ns : int
        First and last log time.
    offset, length : int
        Where it lies in the file, record heads included.
    size : int
        Bytes when decompressed.
    channels : frozenset of int, optional
        Channels with a message in it; None where the file does not say.
    in_chunk : bool
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
    What a file holds.

    Attributes
    ----------
    complete : bool
        The file has its footer and a sound summary, or its data section at least ends as it should.
    scanned : bool
        Found by reading the file through, not from its summary.
    checksums : bool
        Every chunk carries one.
    notes : list of str
        What was found wrong or unusual, one sentence each.
    """

    schemas: dict[int, Schema] = dataclasses.field(default_factory=dict)
    channels: dict[int, Channel] = dataclasses.field(default_factory=dict)
    counts: dict[int, int] = dataclasses.field(default_factory=dict)
    spans: list[Span] = dataclasses.field(default_factory=list)
    attachments: list[tuple[int, int]] = dataclasses.field(default_factory=list)
    metadata: list[tuple[int, int]] = dataclasses.field(default_factory=list)
    complete: bool = True
    scanned: bool = False
    checksums: bool = True
    notes: list[str] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(frozen=True)
class Chunk:
    """A sound chunk met while scanning; `data` is its compressed form."""

    offset: int
    length: int
    head: ChunkHead
    data: bytes
    plain: bytes
    walk: Walk


@dataclasses.dataclass(frozen=True)
class Bare:
    """Sound messages outside of any chunk."""

    offset: int
    length: int
    plain: bytes
    walk: Walk


@dataclasses.dataclass(frozen=True)
class Other:
    """A record of another kind; `body` only for headers, schemas, channels, attachments and metadata."""

    opcode: int
    offset: int
    length: int
    body: bytes


@dataclasses.dataclass(frozen=True)
class Damage:
    """Bytes that could not be used."""

    offset: int
    end: int
    reason: str


Piece = Chunk | Bare | Other | Damage
