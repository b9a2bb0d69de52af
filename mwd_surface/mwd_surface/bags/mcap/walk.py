# SPDX-License-Identifier: Apache-2.0
"""Search for the records in a byte array: a compiled loop for long arrays, plain Python for short ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core import budgets
from mwd_sensors.core.arrays import Bytes
from mwd_sensors.core.compiled import compiled
from mwd_surface.bags.mcap.records import PREFIX, RECORD_HEAD, FormatError


@dataclasses.dataclass(frozen=True)
class Walk:
    """Records found by walking through a byte array."""

    #: `offset`, `size`: shape (n,), int64; position and length of each message's payload, bytes.
    offset: NDArray[np.int64]
    size: NDArray[np.int64]
    channel: NDArray[np.uint16]  #: shape (n,), uint16
    #: `log_ns`, `publish_ns`: shape (n,), int64.
    log_ns: NDArray[np.int64]
    publish_ns: NDArray[np.int64]
    others: NDArray[np.int64]  #: shape (m,), int64; position of each record that is not a message
    end: int  #: position after the last complete record; the length of the data if it consists of complete records
    #: Number of messages left out because their log time is after the year 2262, which int64 cannot hold.
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
def _number(data: Any, at: int) -> int:
    value = np.int64(0)
    for k in range(8):
        value |= np.int64(data[at + k]) << np.int64(8 * k)
    return value  # type: ignore[return-value]


@compiled
def _walk(  # a single flat loop for speed: its body runs for every message of a bag
    data: Any, offset: Any, size: Any, channel: Any, log_ns: Any, publish_ns: Any, others: Any
) -> tuple[int, int, int]:
    at, count, other = 0, 0, 0
    end = len(data)
    while at + 9 <= end:
        length = _number(data, at + 1)
        if length < 0 or length > end - at - 9:
            break
        if data[at] == 5:
            if length < 22:
                break
            if count == len(channel):
                break
            channel[count] = np.uint16(data[at + 9]) | (np.uint16(data[at + 10]) << np.uint16(8))
            log_ns[count] = _number(data, at + 15)
            publish_ns[count] = _number(data, at + 23)
            offset[count] = at + 31
            size[count] = length - 22
            count += 1
        else:
            if other == len(others):
                break
            others[other] = at
            other += 1
        at += 9 + length
    return count, other, at


@compiled
def _count(data: Any) -> tuple[int, int]:
    """Return the number of messages and of other records, so that arrays of the exact size can be allocated."""
    at, count, other = 0, 0, 0
    end = len(data)
    while at + 9 <= end:
        length = _number(data, at + 1)
        if length < 0 or length > end - at - 9:
            break
        if data[at] == 5:
            count += 1
        else:
            other += 1
        at += 9 + length
    return count, other


def walk_records(data: Bytes) -> Walk:
    """
    Return the records in a byte array, shape (n,), uint8.

    The walk stops at the first record that does not fit into the array, at a message shorter than its head, or when the
    records that are not messages exceed their budget; it never raises an error.
    """
    n, m = _count(data)
    offset, size, log_ns, publish_ns = (np.empty(n, dtype=np.int64) for _ in range(4))
    channel = np.empty(n, dtype=np.uint16)
    others = np.empty(min(m, budgets.MCAP.records or m), dtype=np.int64)
    n, m, end = _walk(data, offset, size, channel, log_ns, publish_ns, others)
    walk = Walk(offset[:n], size[:n], channel[:n], log_ns[:n], publish_ns[:n], others[:m], end)
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
