# SPDX-License-Identifier: Apache-2.0
"""
A copy of a recording with additional topics: the original messages byte for byte, with new messages merged by time.

All messages are written in the order of their log time, the original first at equal times, so that any player shows
original and new messages together. Only messages that cannot be written yet are held in memory.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Bytes
from mwd_sensors.core.compiled import compiled
from mwd_surface.bags.bag_reader import Bag, Originals
from mwd_surface.bags.bag_writer import ROSBAG2_RECORD, BagWriter
from mwd_surface.bags.definitions import Definitions
from mwd_surface.bags.mcap.records import MESSAGE_HEAD, MESSAGE_PREFIX

Numbers = NDArray[np.int64]

_PREFIX, _HEAD, _MESSAGE = MESSAGE_PREFIX, MESSAGE_HEAD, Opcode.MESSAGE


class _Rows(NamedTuple):
    """
    Columns of messages, each of shape (n,).

    place : offset of the message's record in the output. log_ns : log time, ns. offset, size : position and length of
    the payload in the input.
    """

    place: Numbers
    log_ns: Numbers
    offset: Numbers
    size: Numbers
    channel: NDArray[np.uint16]
    sequence: Numbers


@dataclasses.dataclass(frozen=True)
class _Source:
    """
    Messages in order of their log time, ns; `offset` and `size` locate their payloads in `data`.

    framed : whether sequence number, log time and publish time precede each payload in `data`. These three are then
    copied; otherwise the sequence number comes from `sequence`, and the publish time is the log time.
    """

    data: Bytes
    log_ns: Numbers
    offset: Numbers
    size: Numbers
    channel: NDArray[np.uint16]
    sequence: Numbers
    framed: bool

    def at(self, where: slice) -> _Source:
        """Return the messages that a slice selects."""
        return _Source(
            self.data,
            self.log_ns[where],
            self.offset[where],
            self.size[where],
            self.channel[where],
            self.sequence[where],
            self.framed,
        )


class MergedBag:
    """
    Writer of a copy of a recording with additional topics.

    Parameters
    ----------
    path : Path
        Folder of the copy; must not exist.
    bag : Bag
        The recording. Its topics, attachments and tables are copied.

    Raises
    ------
    FileExistsError
        `path` exists.
    OSError
        Writing fails; every method that writes may raise this.
    """

    def __init__(self, path: Path, bag: Bag) -> None:
        self._writer = BagWriter(path, custom=bag.custom)
        try:
            self._channels = np.array(
                [self._writer.copy_topic(about) for about in bag.carried.values()],
                dtype=np.uint16,
            )
            for item in bag.attachments():
                self._writer.attach(item.name, item.media_type, item.data, item.log_time)
            for name, table in bag.metadata().items():
                if name != ROSBAG2_RECORD:
                    self._writer.add_metadata(name, table)
        except BaseException:
            self._writer.abandon()
            raise
        self._taken = set(bag.carried)
        self._written: dict[int, int] = {}
        self._originals: list[_Source] = []
        self._new: list[_Source] = []

    @property
    def definitions(self) -> Definitions:
        """Definitions of the message types that new topics can have."""
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

    def add_originals(self, originals: Originals) -> None:
        """Accept messages of the recording; `flush` writes them."""
        self._originals.append(
            _Source(
                originals.data,
                originals.log_ns,
                originals.offset,
                originals.size,
                self._channels[originals.topic],
                np.zeros(len(originals.log_ns), dtype=np.int64),
                originals.framed,
            )
        )

    def add_rows(self, channel: int, rows: Bytes, log_ns: Numbers) -> None:
        """
        Accept new messages of one size; `flush` writes them.

        rows, shape (n, size), uint8; log_ns, shape (n,), int64, not decreasing.
        """
        count, size = rows.shape
        first = self._written.get(channel, 0)
        self._written[channel] = first + count
        self._new.append(
            _Source(
                np.ascontiguousarray(rows).reshape(-1),
                np.asarray(log_ns, dtype=np.int64),
                np.arange(count, dtype=np.int64) * size,
                np.full(count, size, dtype=np.int64),
                np.full(count, channel, dtype=np.uint16),
                np.arange(first + 1, first + count + 1, dtype=np.int64),
                False,
            )
        )

    def flush(self, until_ns: int | None = None) -> None:
        """Write all messages logged up to and including `until_ns`; None writes all."""
        ready: list[_Source] = []
        for waiting in (self._originals, self._new):
            rest = []
            for source in waiting:
                cut = len(source.log_ns) if until_ns is None else int(np.searchsorted(source.log_ns, until_ns, "right"))
                if cut:
                    ready.append(source.at(slice(0, cut)))
                if cut < len(source.log_ns):
                    rest.append(source.at(slice(cut, None)))
            waiting[:] = rest
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
            rows = _Rows(place[begin:end], source.log_ns, source.offset, source.size, source.channel, source.sequence)
            _write_records(records, source.data, rows, source.framed)
            begin = end
        channel = np.concatenate([source.channel for source in ready])[order]
        self._writer.write_records(records, offset, channel, log_ns[order])

    def close(self) -> None:
        """Write the waiting messages and finish the bag."""
        self.flush()
        self._writer.close()

    def __enter__(self) -> MergedBag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        else:
            self._writer.abandon()


@compiled
def _put(out: Bytes, at: int, value: int, size: int) -> None:
    """Write an unsigned little-endian number of `size` bytes at position `at`."""
    for k in range(size):
        out[at + k] = (value >> (8 * k)) & 255


@compiled
def _write_records(out: Bytes, data: Bytes, rows: _Rows, framed: bool) -> None:
    """Write one record for each message, at the offset `rows.place` in `out`."""
    for i in range(len(rows.place)):
        at, source = rows.place[i], rows.offset[i]
        out[at] = _MESSAGE
        _put(out, at + 1, _HEAD + rows.size[i], 8)
        _put(out, at + 9, int(rows.channel[i]), 2)
        if framed:
            # Sequence number, log time and publish time stand directly before the payload.
            out[at + 11 : at + _PREFIX + rows.size[i]] = data[source - 20 : source + rows.size[i]]
        else:
            _put(out, at + 11, rows.sequence[i] & 0xFFFFFFFF, 4)
            _put(out, at + 15, rows.log_ns[i], 8)
            _put(out, at + 23, rows.log_ns[i], 8)
            out[at + _PREFIX : at + _PREFIX + rows.size[i]] = data[source : source + rows.size[i]]
