# SPDX-License-Identifier: Apache-2.0
"""
M-ary pulse position code: a word is split into packets of 3 and 2 bits, and each packet is the position of one pulse.

All times are in units of TU, half a pulse width. The leading edge of a packet with value v is at TU 3 - v for 2 bits
and at TU 7 - v for 3 bits. The window has 4 or 8 TU and is followed by 4 TU, so a bit takes 4 TU.
Source: Erdos Miller, Mud pulse telemetry: M-ary encoding and decoding, 2017.
"""

from __future__ import annotations

from typing import NamedTuple

PULSE_TU = 2  # width of a pulse, TU
GAP_TU = 4  # gap after the window of a packet, TU


class Pulses(NamedTuple):
    """Pulses of a word or of a sequence: leading edges from its start, and its length, TU."""

    edges: tuple[int, ...]
    length: int


def packets(bits: int) -> tuple[int, ...]:
    """
    Return the number of bits of each packet of a word, most significant first.

    Packets have 3 bits; one or two packets of 2 bits at the end make up lengths that 3 does not divide.

    Raises
    ------
    ValueError
        There are fewer than 2 bits, which no packet can hold.
    """
    if bits < 2:
        raise ValueError(f"bits: a packet has 2 or 3 bits, a word of {bits} bits cannot be split into packets")
    twos = -bits % 3
    return (3,) * ((bits - 2 * twos) // 3) + (2,) * twos


def edge_tu(value: int, bits: int) -> int:
    """Return the leading edge of a packet's pulse relative to the start of its window, TU."""
    return (1 << bits) - 1 - value


def window_tu(bits: int) -> int:
    """Return the length of a packet's window including the gap after it, TU."""
    return (1 << bits) + GAP_TU


def encode(code: int, bits: int) -> Pulses:
    """
    Return the pulses of a word.

    Parameters
    ----------
    code : int
        Value of the word; its last bit is the parity bit if the word has one.
    bits : int
        Length of the word, including parity.

    Returns
    -------
    Pulses
        Edges from the start of the word, and the word's duration, TU.
    """
    edges, at, left = [], 0, bits
    for size in packets(bits):
        left -= size
        edges.append(at + edge_tu(code >> left & 2**size - 1, size))
        at += window_tu(size)
    return Pulses(tuple(edges), at)
