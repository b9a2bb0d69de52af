# SPDX-License-Identifier: Apache-2.0
"""Search for the records in a byte array: a compiled loop for long arrays, plain Python for short ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from mwd_sensors.core import budgets
from mwd_sensors.core.arrays import Bytes
from mwd_sensors.core.compiled import compiled
from mwd_surface.bags.mcap.records import MESSAGE_FIELDS, PREFIX, RECORD_HEAD, FormatError

_HEAD = np.dtype(MESSAGE_FIELDS)


@dataclasses.dataclass(frozen=True)
class Walk:
    """
    Records found by walking through a byte array.

    Attributes
    ----------
    offset, size : shape (n,), int64
        Position and length of each message's payload, bytes.
    channel : shape (n,), uint16
    log_ns, publish_ns : shape (n,), int64
    others : shape (m,), int64
        Position of each record that is not a message.
    end : int
        Position after the last complete record; the length of the data if it consists of complete records.
    impossible : int
        Number of messages left out because their log time is after the year 2262, which int64 cannot hold.
    """

    offset: NDArray[np.int64]
    size: NDArray[np.int64]
    channel: NDArray[np.uint16]
    log_ns: NDArray[np.int64]
    publish_ns: NDArray[np.int64]
    others: NDArray[np.int64]
    end: int
    impossible: int = 0

    def at(self, chosen: NDArray[np.bool_]) -> Walk:
        """Return the walk with only the messages for which `chosen`, shape (n,), is true."""
        return dataclasses.replace(
            self,
            offset=self.offset[chosen],
            size=self.size[chosen],
            channel=self.channel[chosen],
            log_ns=self.log_ns[chosen],
            publish_ns=self.publish_ns[chosen],
        )


@compiled
def _find(data: Any, starts: Any) -> tuple[int, int]:
    """Store the positions of the first records; return the number of all records, and the position after the last."""
    at: Any = 0
    count = 0
    while at + 9 <= len(data):
        length: Any = np.int64(0)
        for k in range(8):
            length |= np.int64(data[at + 1 + k]) << np.int64(8 * k)
        if length < 0 or length > len(data) - at - 9:
            break
        if count < len(starts):
            starts[count] = at
        count += 1
        at += 9 + length
    return count, at


def walk_records(data: Bytes) -> Walk:
    """
    Return the records in a byte array, shape (n,), uint8.

    The walk stops at the first record that does not fit into the array, at a message shorter than its head, or when the
    records that are not messages exceed their budget; it never raises an error.
    """
    n, end = _find(data, np.empty(0, dtype=np.int64))
    starts = np.empty(n, dtype=np.int64)
    _find(data, starts)
    size = np.diff(starts, append=end) - _HEAD.itemsize
    is_message = data[starts] == Opcode.MESSAGE
    others = np.flatnonzero(~is_message)
    stops = (np.flatnonzero(is_message & (size < 0)), others[budgets.MCAP.records or n :])
    stop = min([n, *(int(one[0]) for one in stops if len(one))])
    if stop < n:
        end = int(starts[stop])
        starts, size, is_message = starts[:stop], size[:stop], is_message[:stop]
    offset = starts[is_message]
    # View the data as the head of a message at every byte; copy the fields at the messages.
    head = np.ndarray(max(len(data) - _HEAD.itemsize + 1, 0), _HEAD, data, strides=(1,))
    channel = head["channel"][offset]
    log_ns, publish_ns = (head[name][offset].view(np.int64) for name in ("log_ns", "publish_ns"))
    walk = Walk(offset + _HEAD.itemsize, size[is_message], channel, log_ns, publish_ns, starts[~is_message], end)
    # Leave out messages with an impossible (negative) log time: one flipped bit must not lose the other messages.
    possible = walk.log_ns >= 0
    if possible.all():
        return walk
    return dataclasses.replace(walk.at(possible), impossible=int((~possible).sum()))


def records_in(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """
    Yield opcode and body of each record, without a compiled loop; for short data.

    Raises
    ------
    FormatError
        The data do not consist of records, or have more records than the budget.
    """
    view, at, count = memoryview(data), 0, 0
    while at < len(data):
        count += 1
        opcode, length = RECORD_HEAD.unpack_from(view, at) if at + PREFIX <= len(data) else (0, len(data))
        if length > len(data) - at - PREFIX or count > (budgets.MCAP.records or count):
            raise FormatError("the summary is not made of records")
        yield opcode, view[at + PREFIX : at + PREFIX + length]
        at += PREFIX + length


def records_at(data: Bytes, offsets: NDArray[np.int64]) -> list[tuple[int, memoryview]]:
    """Return (opcode, body) of the records at the offsets that `walk_records` found."""
    view = memoryview(data)  # type: ignore[arg-type]
    found = []
    for at in offsets.tolist():
        opcode, length = RECORD_HEAD.unpack_from(view, at)
        found.append((opcode, view[at + PREFIX : at + PREFIX + length]))
    return found
