# SPDX-License-Identifier: Apache-2.0
"""
The last samples of a stream, in a ring of records whose field `stamp_ns` advances from sample to sample.

Places are counted back from the newest sample, which is one back.
"""

from __future__ import annotations

from collections.abc import MutableSequence
from typing import Any

from mwd_sensors.core.compiled import compiled


class Ring:
    """Samples in `rows`, which a subclass declares with their type and how many there are."""

    head: int  #: place of the next sample
    length: int  #: samples there are
    rows: MutableSequence[Any]


@compiled
def place(ring: Ring, back: int) -> int:
    """Place in the ring of the sample so far back, at most the length of the ring."""
    at = ring.head - back
    return at if at >= 0 else at + len(ring.rows)


@compiled
def next_place(ring: Ring) -> int:
    """Take in a sample; returns the place that it is to be written to."""
    at, size = ring.head, len(ring.rows)
    ring.head = at + 1 if at + 1 < size else 0
    ring.length = min(ring.length + 1, size)
    return at


@compiled
def first_from(ring: Ring, at: int) -> int:
    """How far back the first sample at or after a time, ns, lies; 0 where there is none."""
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
    """Places of the samples before and after a time, ns, and the share of the later one; the ends hold."""
    back = first_from(ring, at)
    later = place(ring, max(back, 1))
    if back == 0 or back == ring.length:
        return later, later, 0.0
    earlier = place(ring, back + 1)
    before = ring.rows[earlier].stamp_ns
    return earlier, later, (at - before) / (ring.rows[later].stamp_ns - before)
