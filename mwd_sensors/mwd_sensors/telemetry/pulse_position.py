# SPDX-License-Identifier: Apache-2.0
"""
M-ary pulse position code: a word is cut into packets of 3 and 2 bits, each packet is the place of one pulse.

All times are in units of TU, half a pulse width. A packet of 2 bits has its leading edge at TU 3 - v, one of 3 bits at
TU 7 - v; the window is 4 or 8 TU, and 4 TU separate it from the next one: 4 TU a bit.
Source: Erdos Miller, Mud pulse telemetry: M-ary encoding and decoding, 2017.
"""

from __future__ import annotations

from typing import NamedTuple

PULSE_TU = 2
GAP_TU = 4


class Pulses(NamedTuple):
    """Leading edges after the start, and the length of what they belong to; in TU."""

    edges: tuple[int, ...]
    length: int


def packets(bits: int) -> tuple[int, ...]:
    """
    Bits of the packets of a word, most significant first.

    Packets of 3 bits, where 3 does not divide the length one or two of 2 bits at the end.

    Raises
    ------
    ValueError
        Fewer than 2 bits: no packet holds one.
    """
    if bits < 2:
        raise ValueError(f"bits: a packet has 2 or 3 bits, a word of {bits} cannot be cut into such")
    twos = -bits % 3
    return (3,) * ((bits - 2 * twos) // 3) + (2,) * twos


def edge_tu(value: int, bits: int) -> int:
    """Leading edge of a packet's pulse after the start of its window, TU."""
    return (1 << bits) - 1 - value


def window_tu(bits: int) -> int:
    """Window of a packet with the gap behind it, TU."""
    return (1 << bits) + GAP_TU


def encode(code: int, bits: int) -> Pulses:
    """
    Leading edges of a word.

    Parameters
    ----------
    code : int
        Value with its parity bit, if it has one, as the last.
    bits : int
        Length, parity included.

    Returns
    -------
    Pulses
        Edges from the start of the word, and the time it takes, TU.
    """
    edges, at, left = [], 0, bits
    for size in packets(bits):
        left -= size
        edges.append(at + edge_tu(code >> left & 2**size - 1, size))
        at += window_tu(size)
    return Pulses(tuple(edges), at)
