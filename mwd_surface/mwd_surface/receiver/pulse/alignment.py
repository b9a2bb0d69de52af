# SPDX-License-Identifier: Apache-2.0
"""
Test whether the words after a sync are shifted by some TU.

Noise in a sync widens the response estimated from it. The words after it may then be decoded one TU off, and the
response and clock estimated from these words agree with the error; if the clock is far off, later words are shifted
further. Sync and words are therefore decoded together again, from the decided places and from places one TU earlier and
later; this repeats from the best of these while the evidence improves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_surface.receiver.pulse import segment, trellis
from mwd_surface.receiver.pulse.tool_clock import ToolClock

# Log likelihood ratio above which shifted places replace the decided ones; noise reaches it once in 20 000 cases.
_BETTER = 10.0


class Aligned(NamedTuple):
    """
    Result of decoding sync and words together.

    Attributes
    ----------
    clock : ToolClock
    channel : Channel
    probability : ndarray, shape (k, values)
        Probability of each value of each packet.
    evidence : float
        Log likelihood ratio of the pulses against no pulses.
    """

    clock: ToolClock
    channel: segment.Channel
    probability: Array
    evidence: float = 0.0


Decoder = Callable[[ToolClock, Array, segment.Channel], segment.Decision]


def align(decode: Decoder, rows: Indices, start: Aligned) -> Aligned:
    """
    Shift the words where that is more likely.

    Parameters
    ----------
    decode : callable
        Decodes sync and words, starting from a clock, a channel and the probabilities of the packet values. The
        response is estimated from all of them; the timing of the result is that of the whole transmission.
    rows : ndarray, shape (k, 6)
        Packets of the sync and of the words after it.
    start : Aligned
        Result of the stretch-by-stretch decoder.

    Returns
    -------
    Aligned
        `start` if the words do not move. A packet moves by at most as many TU as its window has places.
    """
    stays = best = _from(decode, rows, start, 0)
    # After as many shifts as a window has places, none of the original words is left in it.
    for _ in range(int(rows[:, trellis.COUNT].max())):
        other = max((_from(decode, rows, best, by) for by in (-1, 1)), key=lambda one: one.evidence)
        # An evidence of NaN or infinity decides nothing.
        if not _BETTER <= other.evidence - best.evidence < math.inf:
            break
        best = other
    return start if best is stays else best


def _from(decode: Decoder, rows: Indices, start: Aligned, by: int) -> Aligned:
    """Decode sync and words from places shifted by some TU: first with the start clock, then with their own."""
    decision = decode(start.clock, moved(rows, start.probability, by), start.channel)
    clock, _ = start.clock.followed(decision.timing, None)
    decision = decode(clock, decision.probability, decision.channel)
    return Aligned(clock, decision.channel, decision.probability, decision.evidence)


def moved(rows: Indices, probability: Array, by: int) -> Array:
    """Shift the packet value probabilities by some TU; probability that leaves its window is spread evenly over it."""
    count = rows[:, trellis.COUNT, None]
    at = np.arange(probability.shape[1])[None, :]
    value = np.where(rows[:, trellis.RISING, None] == 1, at - by, at + by)
    inside = (at < count) & (value >= 0) & (value < count)
    out = np.where(inside, np.take_along_axis(probability, np.clip(value, 0, count - 1), 1), 0.0)
    return np.asarray(out + (1.0 - out.sum(axis=1, keepdims=True)) * trellis.uniform(rows))
