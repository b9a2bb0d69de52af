# SPDX-License-Identifier: Apache-2.0
"""
Combinatorial pulse code: each way to place M equal pulses in a window is a code, in lexicographic order.

M of n slots hold a leading edge, with at least `SPACING_TU` between neighbours, which gives
C(n - (M - 1)(SPACING_TU - 1), M) codes (L. H. Rorden, US 4787093, 1988: the combinatorial number system). For each word
length, M is the number of pulses with the shortest window, among those not above the number of pulses of the pulse
position code.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence

import numpy as np

from mwd_sensors.core.arrays import Indices
from mwd_sensors.telemetry.pulse_position import Pulses
from mwd_sensors.telemetry.sequences import SequenceItem

# Shortest time between two leading edges, TU: a pulse of 2 TU, and 2 TU in which the valve closes and the mud settles.
SPACING_TU = 4
# Time from the last possible edge to the next word, TU: a pulse of 2 TU, and a gap of 2 TU.
_TAIL_TU = 4
# Largest number of bits of a word: a receiver compares the signal with all codes of the word.
MOST_BITS = 16


def check(items: Sequence[SequenceItem]) -> None:
    """Raise ValueError if a word is longer than `MOST_BITS`, parity included."""
    for item in items:
        if item.length > MOST_BITS:
            raise ValueError(f"{item.name} has {item.length} bits; the combinatorial code takes {MOST_BITS} at most")


@functools.cache
def shape(bits: int) -> tuple[int, int]:
    """
    Return the number of pulses, and the number of slots of 1 TU, of a word with this many bits.

    Raises
    ------
    ValueError
        There are fewer than 2 bits.
    """
    if bits < 2:
        raise ValueError(f"bits: a word needs 2 or more, got {bits}")
    most = math.ceil(bits / 3) + (bits % 3 == 1)
    return min(((m, _slots(bits, m)) for m in range(1, most + 1)), key=lambda found: (found[1], found[0]))


def _slots(bits: int, pulses: int) -> int:
    free = pulses
    while math.comb(free, pulses) < 2**bits:
        free += 1
    return free + (pulses - 1) * (SPACING_TU - 1)


@functools.cache
def values(bits: int) -> Indices:
    """
    Return the shift of each pulse from its first possible position, TU, for each code; shape (2^bits, pulses).

    Row k is code k; rows are in lexicographic order. The values of a row never decrease.
    """
    count, slots = shape(bits)
    free = slots - (count - 1) * (SPACING_TU - 1)
    rows = itertools.islice(itertools.combinations(range(free), count), 2**bits)
    return np.array(list(rows), dtype=np.int64) - np.arange(count)


@functools.cache
def odd(bits: int) -> Indices:
    """Return 1 for each code with an odd number of binary ones, else 0; shape (2^bits,)."""
    return np.array([code.bit_count() & 1 for code in range(2**bits)])


def encode(code: int, bits: int) -> Pulses:
    """
    Return the pulses of a word.

    Parameters
    ----------
    code : int
        Value of the word; its last bit is the parity bit if the word has one.
    bits : int
        Length of the word, including parity.

    Raises
    ------
    ValueError
        The code does not fit into the bits.
    """
    if not 0 <= code < 2**bits:
        raise ValueError(f"code: {code} does not fit {bits} bits")
    count, slots = shape(bits)
    free = slots - (count - 1) * (SPACING_TU - 1)
    edges, at = [], 0
    for k in range(count):
        left = count - 1 - k
        while (here := math.comb(free - at - 1, left)) <= code:
            code -= here
            at += 1
        edges.append(at + k * (SPACING_TU - 1))
        at += 1
    return Pulses(tuple(edges), slots + _TAIL_TU)
