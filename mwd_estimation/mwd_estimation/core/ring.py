# SPDX-License-Identifier: Apache-2.0
"""
The last samples of a stream, in a ring of records whose field `stamp_ns` advances from sample to sample.

`head` is the place of the next sample, `length` how many there are; places are counted back from the newest, which is
one back.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mwd_sensors.core.compiled import compiled


@compiled
def place(ring: Sequence[Any], head: int, back: int) -> int:
    """Place in the ring of the sample so far back, at most the length of the ring."""
    at = head - back
    return at if at >= 0 else at + len(ring)


@compiled
def next_head(ring: Sequence[Any], head: int) -> int:
    """Place of the next sample but one."""
    return head + 1 if head + 1 < len(ring) else 0


@compiled
def first_from(ring: Sequence[Any], head: int, length: int, at: int) -> int:
    """How far back the first sample at or after a time, ns, lies; 0 where there is none."""
    low, high = 0, length
    while low < high:
        middle = (low + high + 1) // 2
        if ring[place(ring, head, middle)].stamp_ns >= at:
            low = middle
        else:
            high = middle - 1
    return low


@compiled
def around(ring: Sequence[Any], head: int, length: int, at: int) -> tuple[int, int, float]:
    """Places of the samples before and after a time, ns, and the share of the later one; the ends hold."""
    back = first_from(ring, head, length, at)
    later = place(ring, head, max(back, 1))
    if back == 0 or back == length:
        return later, later, 0.0
    earlier = place(ring, head, back + 1)
    before = ring[earlier].stamp_ns
    return earlier, later, (at - before) / (ring[later].stamp_ns - before)
