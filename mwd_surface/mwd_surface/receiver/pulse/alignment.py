# SPDX-License-Identifier: Apache-2.0
"""
Whether the words behind a sync are some TU off.

Noise in a sync widens the response that it teaches. The words behind it may then be taken for others, all of them one
TU off, with which the response and the clock that learn from these words agree; behind a clock that is far off, words
are the farther off the later they are. So sync and words are decoded together once more, from the places decided and
from those one TU earlier and later, and again from the likeliest of these as long as that is better.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_surface.receiver.pulse import segment, trellis
from mwd_surface.receiver.pulse.tool_clock import ToolClock

# Log likelihood ratio from which on other places are taken for the right ones: noise has it once in 20 000 cases.
_BETTER = 10.0


class Aligned(NamedTuple):
    """
    Sync and words decoded together.

    Attributes
    ----------
    clock : ToolClock
    channel : Channel
    probability : ndarray, shape (k, values)
        Of the packets' values.
    evidence : float
        Log likelihood ratio of the pulses to none.
    """

    clock: ToolClock
    channel: segment.Channel
    probability: Array
    evidence: float = 0.0


Decoder = Callable[[ToolClock, Array, segment.Channel], segment.Decision]


def align(decode: Decoder, rows: Indices, start: Aligned) -> Aligned:
    """
    Move the words where that is likelier.

    Parameters
    ----------
    decode : callable
        Decodes sync and words with a clock and a channel to begin with, and the probabilities of the packets' values;
        the response learns from all of them. Its timing is that of the transmission.
    rows : ndarray, shape (k, 6)
        Packets of the sync and of what comes behind it.
    start : Aligned
        As decoded stretch by stretch.

    Returns
    -------
    Aligned
        `start` where the words stay. A packet moves by no more TU than its window has places.
    """
    stays = best = _from(decode, rows, start, 0)
    # After as many moves as a window has places, nothing of the words decided is left in it.
    for _ in range(int(rows[:, trellis.COUNT].max())):
        other = max((_from(decode, rows, best, by) for by in (-1, 1)), key=lambda one: one.evidence)
        # Evidence that is no number decides nothing.
        if not _BETTER <= other.evidence - best.evidence < math.inf:
            break
        best = other
    return start if best is stays else best


def _from(decode: Decoder, rows: Indices, start: Aligned, by: int) -> Aligned:
    """Sync and words as decoded from places later by some TU: first with the clock before, then with their own."""
    decision = decode(start.clock, moved(rows, start.probability, by), start.channel)
    clock, _ = start.clock.followed(decision.timing, None)
    decision = decode(clock, decision.probability, decision.channel)
    return Aligned(clock, decision.channel, decision.probability, decision.evidence)


def moved(rows: Indices, probability: Array, by: int) -> Array:
    """Probability of packets' values with each pulse later by so many TU; what leaves its window may be anywhere."""
    count = rows[:, trellis.COUNT, None]
    at = np.arange(probability.shape[1])[None, :]
    value = np.where(rows[:, trellis.RISING, None] == 1, at - by, at + by)
    inside = (at < count) & (value >= 0) & (value < count)
    out = np.where(inside, np.take_along_axis(probability, np.clip(value, 0, count - 1), 1), 0.0)
    return np.asarray(out + (1.0 - out.sum(axis=1, keepdims=True)) * trellis.uniform(rows))
