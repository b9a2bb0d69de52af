# SPDX-License-Identifier: Apache-2.0
"""
Ring buffer of the last samples of a stream; each record has a field `stamp_ns`, which increases with every sample.

Samples are counted back from the newest, which is number 1.
"""

from __future__ import annotations

from collections.abc import MutableSequence
from typing import Any

from mwd_sensors.core.compiled import compiled


class Ring:
    """Base class of ring buffers; a subclass declares the record type and the size of `rows`."""

    head: int  #: index in `rows` where the next sample is written
    length: int  #: number of samples stored
    rows: MutableSequence[Any]


@compiled
def place(ring: Ring, back: int) -> int:
    """Return the index in `rows` of sample number `back`, counted back from the newest (1) to the oldest (`length`)."""
    at = ring.head - back
    return at if at >= 0 else at + len(ring.rows)


@compiled
def next_place(ring: Ring) -> int:
    """Make room for one sample, and return the index in `rows` where it must be written."""
    at, size = ring.head, len(ring.rows)
    ring.head = at + 1 if at + 1 < size else 0
    ring.length = min(ring.length + 1, size)
    return at


@compiled
def first_from(ring: Ring, at: int) -> int:
    """
    Return the number of the first sample at or after a time, ns, counted back from the newest sample (number 1).

    Returns 0 if all samples are earlier.
    """
    low, high = 0, ring.length
    while low < high:
        middle = (low + high + 1) // 2
        if ring.rows[place(ring, middle)].stamp_ns >= at:
            low = middle
        else:
            high = middle - 1
    return low


@compiled
def around(ring: Ring, at: int) -> tuple[int, int, float]:
    """
    Return the indices in `rows` of the samples before and after a time, ns, and the weight of the later sample.

    Outside the stored samples both indices are the index of the nearest sample, and the weight is 0.
    """
    back = first_from(ring, at)
    later = place(ring, max(back, 1))
    if back == 0 or back == ring.length:
        return later, later, 0.0
    earlier = place(ring, back + 1)
    before = ring.rows[earlier].stamp_ns
    return earlier, later, (at - before) / (ring.rows[later].stamp_ns - before)
