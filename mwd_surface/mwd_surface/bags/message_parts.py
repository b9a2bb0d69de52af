# SPDX-License-Identifier: Apache-2.0
"""Messages of a bag as arrays of offsets, sizes and log times, cut and joined without loops over messages."""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Samples, Stamps

# By topic: log times, ns, and samples.
Block = dict[str, tuple[Stamps, Any]]

NEVER = 2**62  # later than any stamp, ns
_HEAD = struct.Struct("<IQQ")  # sequence number, log time and publish time of a message


@dataclasses.dataclass
class MessagePart:
    """Messages of one span of a file, selected and in time order."""

    rank: tuple[int, int]  #: sort key of the span: number of the file, byte offset in the file
    file: int  #: number of the file
    #: Bytes that contain the messages. In front of each payload are sequence number, log time and publish time, as in a
    #: record of an MCAP file.
    data: NDArray[np.uint8]
    #: `log_ns`, `offset`, `size`, `channel`: shape (n,); for each message: log time, ns; offset and length of its
    #: payload; channel number in the file.
    log_ns: Stamps
    offset: NDArray[np.int64]
    size: NDArray[np.int64]
    channel: NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.log_ns)

    def split(self, mark: int) -> tuple[MessagePart, MessagePart]:
        """Return the messages before the log time `mark`, ns, and the messages at or after `mark`."""
        cut = int(np.searchsorted(self.log_ns, mark))
        return self.at(slice(0, cut)), self.at(slice(cut, None))

    def at(self, where: Any) -> MessagePart:
        """Return the messages that a slice, a mask or an array of indices selects."""
        return MessagePart(
            self.rank,
            self.file,
            self.data,
            self.log_ns[where],
            self.offset[where],
            self.size[where],
            self.channel[where],
        )


def blocks_of(pieces: dict[str, list[tuple[Stamps, Any]]], block_messages: int) -> Iterator[Block]:
    """
    Join and sort the pieces of each topic, and yield them as blocks.

    If all pieces together have at least twice `block_messages` messages, they are cut, at the same times in all topics,
    into blocks of about `block_messages` messages; otherwise they give one block.
    """
    joined: Block = {}
    for name, parts in pieces.items():
        log_ns = parts[0][0] if len(parts) == 1 else np.concatenate([part[0] for part in parts])
        samples = parts[0][1]
        if len(parts) > 1:
            listed = isinstance(samples, list)
            samples = [one for part in parts for one in part[1]] if listed else one_array([p[1] for p in parts])
        if (log_ns[1:] < log_ns[:-1]).any():
            order = np.argsort(log_ns, kind="stable")
            log_ns = log_ns[order]
            samples = [samples[k] for k in order.tolist()] if isinstance(samples, list) else samples[order]
        joined[name] = (log_ns, samples)
    total = sum(len(log_ns) for log_ns, _ in joined.values())
    if total < 2 * block_messages:
        yield {name: part for name, part in joined.items() if len(part[0])}
        return
    times = np.sort(np.concatenate([log_ns for log_ns, _ in joined.values()]))
    marks = np.unique(times[block_messages::block_messages])
    done = dict.fromkeys(joined, 0)
    for mark in [*marks.tolist(), NEVER]:
        block: Block = {}
        for name, (log_ns, samples) in joined.items():
            cut = int(np.searchsorted(log_ns, mark))
            if cut > done[name]:
                block[name] = (log_ns[done[name] : cut], samples[done[name] : cut])
                done[name] = cut
        if block:
            yield block


def merged(parts: list[tuple[Stamps, Samples]]) -> tuple[Stamps, Samples]:
    """Return (log_ns, samples) of several parts of one type, merged in order of log time."""
    if len(parts) == 1:
        return parts[0]
    log_ns = np.concatenate([part[0] for part in parts])
    order = np.argsort(log_ns, kind="stable")
    return log_ns[order], one_array([part[1] for part in parts])[order]


def one_array(parts: list[Samples]) -> Samples:
    """Return samples of one type as one array; bytes are joined, because numpy joins records field by field, slowly."""
    joined: NDArray[np.uint8] = np.concatenate([part.view(np.uint8) for part in parts])
    return joined.view(parts[0].dtype)


def rows_at(data: NDArray[np.uint8], offset: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """Return messages of one size as rows, shape (n, size): a view if all offsets have equal steps, else a copy."""
    if len(offset) > 1:
        steps = offset[1:] - offset[:-1]
        if steps[0] > 0 and (steps == steps[0]).all():
            first = int(offset[0])
            return np.lib.stride_tricks.as_strided(
                data[first:], (len(offset), size), (int(steps[0]), 1), writeable=False
            )
    return np.lib.stride_tricks.sliding_window_view(data, size)[offset]


def part_of(rows: list[tuple[int, int, bytes]]) -> MessagePart:
    """Return a part made of single messages, given as (log_ns, channel, bytes)."""
    log_ns = np.array([row[0] for row in rows], dtype=np.int64)
    size = np.array([len(row[2]) for row in rows], dtype=np.int64)
    channel = np.array([row[1] for row in rows], dtype=np.uint16)
    records = b"".join(_HEAD.pack(0, row[0], row[0]) + row[2] for row in rows)
    offset = np.cumsum(size + _HEAD.size) - size
    return MessagePart((0, 0), 0, np.frombuffer(records, dtype=np.uint8), log_ns, offset, size, channel)
