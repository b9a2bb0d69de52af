# SPDX-License-Identifier: Apache-2.0
"""
A copy of a recording with additional topics: the original messages byte for byte, with new messages merged by time.

All messages are written in the order of their log time, the original first at equal times, so that any player shows
original and new messages together. Only messages that cannot be written yet are held in memory.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Bytes
from mwd_sensors.core.compiled import compiled
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.bags.bag_writer import ROSBAG2_RECORD, BagWriter
from mwd_surface.bags.definitions import Definitions
from mwd_surface.bags.mcap.records import MESSAGE_FIELDS, MESSAGE_HEAD, MESSAGE_PREFIX
from mwd_surface.bags.message_parts import NEVER, MessagePart

Numbers = NDArray[np.int64]

_PREFIX, _HEAD, _MESSAGE = MESSAGE_PREFIX, MESSAGE_HEAD, Opcode.MESSAGE
# Fields of a message record in front of its payload: sequence number, log time and publish time.
_HEAD_FIELDS = MESSAGE_FIELDS[-3:]


@contextlib.contextmanager
def merged_bag(path: Path, bag: Bag) -> Iterator[MergedBag]:
    """
    Yield a writer of a copy of a recording; the copy is finished after the block, and deleted if the block fails.

    path : folder of the copy. bag : recording, whose topics, attachments and tables are copied.

    Raises
    ------
    FileExistsError
        `path` exists.
    OSError
        Writing fails; every method of the writer may raise this.
    """
    with BagWriter(path, custom=bag.custom) as writer:
        merged = MergedBag(writer, bag)
        yield merged
        merged.flush()


class MergedBag:
    """Writer of a copy of a recording with additional topics; see `merged_bag`."""

    def __init__(self, writer: BagWriter, bag: Bag) -> None:
        self._writer = writer
        self._channels = np.array([writer.copy_topic(about) for about in bag.carried.values()], dtype=np.uint16)
        for item in bag.attachments():
            writer.attach(item.name, item.media_type, item.data, item.log_time)
        for name, table in bag.metadata().items():
            if name != ROSBAG2_RECORD:
                writer.add_metadata(name, table)
        self._taken = set(bag.carried)
        self._written: dict[int, int] = {}
        self._originals: list[MessagePart] = []
        self._new: list[MessagePart] = []

    @property
    def definitions(self) -> Definitions:
        """Definitions of the message types that `topic` accepts."""
        return self._writer.definitions

    def topic(self, name: str, type_name: str) -> tuple[int, str]:
        """
        Return channel and name of a new topic.

        If `name` is in use already, "processed/" is inserted before the last part of the name. Raises DefinitionError
        if the type is unknown.
        """
        if name in self._taken:
            head, slash, tail = name.rpartition("/")
            name = f"{head}{slash}processed/{tail}"
        return self._writer.topic(name, type_name), name

    def add_originals(self, originals: MessagePart) -> None:
        """Accept messages of the recording, as from `Bag.blocks_and_originals`; `flush` writes them."""
        self._originals.append(dataclasses.replace(originals, channel=self._channels[originals.channel]))

    def add_rows(self, channel: int, rows: Bytes, log_ns: Numbers) -> None:
        """
        Accept new messages of one size; `flush` writes them.

        rows, shape (n, size), uint8; log_ns, shape (n,), int64, not decreasing.
        """
        count, size = rows.shape
        first = self._written.get(channel, 0)
        self._written[channel] = first + count
        messages = np.empty(count, dtype=[*_HEAD_FIELDS, ("data", "u1", (size,))])
        messages["sequence"] = np.arange(first + 1, first + count + 1) & 0xFFFFFFFF
        messages["log_ns"] = messages["publish_ns"] = log_ns
        messages["data"] = rows
        offset = np.arange(1, count + 1) * messages.itemsize - size
        sizes, channels = np.full(count, size), np.full(count, channel, dtype=np.uint16)
        stamps = np.asarray(log_ns, dtype=np.int64)
        self._new.append(MessagePart((0, 0), 0, messages.view(np.uint8), stamps, offset, sizes, channels))

    def flush(self, until_ns: int | None = None) -> None:
        """Write all messages logged up to and including `until_ns`; None writes all."""
        mark = NEVER if until_ns is None else until_ns + 1
        ready: list[MessagePart] = []
        for waiting in (self._originals, self._new):
            halves = [part.split(mark) for part in waiting]
            ready += [early for early, _ in halves if len(early)]
            waiting[:] = [late for _, late in halves if len(late)]
        if not ready:
            return
        log_ns = np.concatenate([source.log_ns for source in ready])
        length = np.concatenate([source.size for source in ready]) + _PREFIX
        order = np.argsort(log_ns, kind="stable")
        ends = np.cumsum(length[order])
        offset = ends - length[order]
        place = np.empty(len(order), dtype=np.int64)
        place[order] = offset
        records = np.empty(int(ends[-1]), dtype=np.uint8)
        begin = 0
        for source in ready:
            end = begin + len(source.log_ns)
            _write_records(records, place[begin:end], source.data, source.offset, source.size, source.channel)
            begin = end
        channel = np.concatenate([source.channel for source in ready])[order]
        self._writer.write_records(records, offset, channel, log_ns[order])


@compiled
def _put(out: Bytes, at: int, value: int, size: int) -> None:
    """Write an unsigned little-endian number of `size` bytes at position `at`."""
    for k in range(size):
        out[at + k] = (value >> (8 * k)) & 255


@compiled
def _write_records(
    out: Bytes, place: Numbers, data: Bytes, offset: Numbers, size: Numbers, channel: NDArray[np.uint16]
) -> None:
    """Write one record for each message, at the offset `place` in `out`; `offset` and `size`: its payload in `data`."""
    for i in range(len(place)):
        at, source = place[i], offset[i]
        out[at] = _MESSAGE
        _put(out, at + 1, _HEAD + size[i], 8)
        _put(out, at + 9, int(channel[i]), 2)
        # Sequence number, log time and publish time stand directly before the payload.
        out[at + 11 : at + _PREFIX + size[i]] = data[source - 20 : source + size[i]]
