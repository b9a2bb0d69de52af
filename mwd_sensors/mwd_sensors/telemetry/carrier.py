# SPDX-License-Identifier: Apache-2.0
"""
Send words on a carrier: blocks of words with header and CRC-16, coded, interleaved, modulated as BPSK, DPSK or QPSK.

A block is sent as first half, marker of known symbols, second half. From the marker in the middle, which is close to
both ends, the receiver estimates time, phase and channel. All blocks have the same length, and the header of each block
identifies its words, so that a receiver can start with any block.
Sources: J. G. Proakis, M. Salehi, Digital Communications, 5th ed., 2008, sections 3.2 and 4.5; S. Crozier, New
high-spread high-distance interleavers for turbo-codes, 2000 (relative prime interleaver).
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mwd_sensors.core.arrays import Indices
from mwd_sensors.core.settings import setting
from mwd_sensors.telemetry import convolution
from mwd_sensors.telemetry.checksum import CRC_BYTES, START, holds, signed
from mwd_sensors.telemetry.sequences import SequenceItem

Complex = NDArray[np.complex128]
# Bits of the marker. Its aperiodic autocorrelation outside the peak is at most 2, the lowest of all sequences of 20
# symbols +1 and -1.
_MARKER = 0x4D4E
MARKER_SYMBOLS = 20
KINDS = ("survey", "toolface")
# Largest number of sequences of a kind, and of blocks of a sequence: 3 and 4 bits of the header.
MOST_SEQUENCES, MOST_BLOCKS = 8, 16
_HEADER_BYTES = 1
_BITS_PER_SYMBOL = {"bpsk": 1, "dpsk": 1, "qpsk": 2}


@dataclasses.dataclass(frozen=True)
class Carrier:
    """A carrier, its modulation and the size of its blocks."""

    medium: str = setting(
        "mud",
        "Medium of the carrier: pressure of the mud (siren, oscillator), voltage in the earth, or the strength of the "
        "field of a coil.",
        choices=("mud", "earth", "coil"),
    )
    modulation: str = setting(
        "qpsk",
        "Modulation of the phase. BPSK and QPSK need a steady phase; DPSK tolerates a drifting one but needs about 2 "
        "dB more.",
        choices=tuple(_BITS_PER_SYMBOL),
    )
    frequency_hz: float = setting(
        12.0,
        "Frequency of the carrier; with a coil, the frequency of the changes of field strength that carry the symbols.",
        low=0.5,
        high=200.0,
    )
    symbol_rate_hz: float = setting(2.5, "Symbols per second. A lower rate reaches greater depth.", low=0.1, high=50.0)
    block_bits: int = setting(
        40,
        "Bits of words in a block, a multiple of 8. Longer blocks have less overhead (marker, check) and more delay.",
        unit="bit",
        low=16,
        high=240,
    )

    def __post_init__(self) -> None:
        """Raise ValueError if the block is not a whole number of bytes, or the band reaches down to zero frequency."""
        if self.block_bits % 8:
            raise ValueError(f"block_bits: must be a multiple of 8, got {self.block_bits}")
        if self.frequency_hz < self.symbol_rate_hz:
            raise ValueError(
                f"frequency_hz: {self.frequency_hz:g} must not be below symbol_rate_hz ({self.symbol_rate_hz:g})"
            )

    @property
    def coded_bits(self) -> int:
        """Number of coded bits of a block: header, words and check."""
        return 2 * (8 * (_HEADER_BYTES + CRC_BYTES) + self.block_bits + convolution.MEMORY)

    @property
    def half(self) -> int:
        """Number of symbols of a block before its marker."""
        return self.coded_bits // _BITS_PER_SYMBOL[self.modulation] // 2 + (self.modulation == "dpsk")

    @property
    def block_symbols(self) -> int:
        """Number of symbols of a block, including the marker."""
        data = self.coded_bits // _BITS_PER_SYMBOL[self.modulation]
        return MARKER_SYMBOLS + data + (self.modulation == "dpsk")

    @property
    def block_s(self) -> float:
        """Duration of a block, s."""
        return self.block_symbols / self.symbol_rate_hz


@dataclasses.dataclass(frozen=True)
class Coil:
    """Transmitting coil of a sonde, wound about the tool axis; the carrier modulates the strength of its field."""

    frequency_hz: float = setting(
        8025.0,
        "Frequency of the field. Midway between two harmonics of the mains the receiver is disturbed least.",
        low=500.0,
        high=100_000.0,
    )
    moment_a_m2: float = setting(
        5.0,
        "Moment of the coil: current times turns times area, with its core. Determine it from the strength "
        "measured on the surface at a known distance (`mwd tool locate --calibrate`).",
        unit="A m^2",
        low=1e-4,
        high=1e4,
    )
    depth: float = setting(
        0.5, "Change of the strength by the symbols, as a share of the strength.", low=0.05, high=1.0
    )


class BlockName(NamedTuple):
    """Identity of the words in a block: kind and number of the sequence, and position of the block in the sequence."""

    kind: str
    number: int
    place: int


@functools.cache
def marker() -> Complex:
    """Return the known symbols in the middle of a block, shape (20,): +1 or -1."""
    return np.array([1.0 - 2.0 * (_MARKER >> k & 1) for k in reversed(range(MARKER_SYMBOLS))], dtype=complex)


@functools.cache
def interleaver(count: int) -> Indices:
    """
    Return the index of the coded bit that is sent at each position, shape (count,).

    Coded bits that are sent at neighbouring positions are 0.618 of the block apart (golden section), so that a long
    disturbance hits coded bits far from each other.
    """
    step = round(count * (math.sqrt(5.0) - 1.0) / 2.0)
    while math.gcd(step, count) > 1:
        step += 1
    return np.asarray(step * np.arange(count) % count)


@functools.cache
def data_places(carrier: Carrier) -> Indices:
    """
    Return the positions, within a block, of the symbols that carry coded bits, shape (n,).

    DPSK codes a bit in the change from the previous symbol, so the first symbol of a block carries no bit.
    """
    places = np.arange(carrier.block_symbols)
    inside = (places >= carrier.half) & (places < carrier.half + MARKER_SYMBOLS)
    return places[~inside & (places >= (carrier.modulation == "dpsk"))]


def blocks_of(items: tuple[SequenceItem, ...], capacity: int) -> tuple[tuple[SequenceItem, ...], ...]:
    """
    Return the blocks of a sequence in order, each with as many whole words as fit.

    Raises
    ------
    ValueError
        A word is longer than a block, or the sequence needs more blocks than the header can number.
    """
    blocks: list[list[SequenceItem]] = [[]]
    for item in items:
        if item.length > capacity:
            raise ValueError(f"{item.name} has {item.length} bits, more than a block holds (block_bits: {capacity})")
        if sum(one.length for one in blocks[-1]) + item.length > capacity:
            blocks.append([])
        blocks[-1].append(item)
    if len(blocks) > MOST_BLOCKS:
        raise ValueError(
            f"the sequence needs {len(blocks)} blocks of {capacity} bits, more than {MOST_BLOCKS}: raise block_bits"
        )
    return tuple(tuple(block) for block in blocks)


def packed(codes: Sequence[int], lengths: Sequence[int], capacity: int) -> bytes:
    """Return the codes one after another, most significant bit first, with zeros at the end, `capacity` bits in all."""
    whole = 0
    for code, length in zip(codes, lengths, strict=True):
        whole = whole << length | code
    return (whole << (capacity - sum(lengths))).to_bytes(capacity // 8, "big")


def unpacked(data: bytes, lengths: Sequence[int]) -> tuple[int, ...]:
    """Return the codes in bytes made by `packed`; the filling at the end is ignored."""
    whole, left = int.from_bytes(data, "big"), 8 * len(data)
    codes = []
    for length in lengths:
        left -= length
        codes.append(whole >> left & (1 << length) - 1)
    return tuple(codes)


def block_bits(
    carrier: Carrier, name: BlockName, codes: Sequence[int], lengths: Sequence[int], start: int = START
) -> Indices:
    """Return header, words and check of a block as bits, 0 or 1, before coding, shape (24 + block_bits,)."""
    header = KINDS.index(name.kind) << 7 | name.number << 4 | name.place
    data = signed(bytes([header]) + packed(codes, lengths, carrier.block_bits), start)
    return np.unpackbits(np.frombuffer(data, dtype=np.uint8)).astype(np.int64)


def read_block(bits: Indices, start: int = START) -> tuple[BlockName, bytes] | None:
    """Return the block's name and its packed words from decoded bits, or None if the check fails."""
    data = np.packbits(np.asarray(bits, dtype=np.uint8)).tobytes()
    if not holds(data, start):
        return None
    return BlockName(KINDS[data[0] >> 7], data[0] >> 4 & 7, data[0] & 15), data[_HEADER_BYTES:-CRC_BYTES]


def symbols(carrier: Carrier, bits: Indices) -> Complex:
    """Return the symbols of a block, shape (block_symbols,), each of magnitude 1; bits as from `block_bits`."""
    coded = convolution.encode(bits)
    return mapped(carrier, coded[interleaver(len(coded))])


def mapped(carrier: Carrier, sent: Indices) -> Complex:
    """Return the symbols of a block, shape (block_symbols,): the marker and interleaved coded bits `sent`, 0 or 1."""
    out = np.empty(carrier.block_symbols, dtype=complex)
    first = carrier.half
    out[first : first + MARKER_SYMBOLS] = marker()
    signs = 1.0 - 2.0 * sent
    if carrier.modulation == "qpsk":
        out[data_places(carrier)] = (signs[0::2] + 1j * signs[1::2]) / math.sqrt(2.0)
    elif carrier.modulation == "bpsk":
        out[data_places(carrier)] = signs
    else:
        out[:first] = np.cumprod(np.concatenate([[1.0], signs[: first - 1]]))
        out[first + MARKER_SYMBOLS :] = marker()[-1] * np.cumprod(signs[first - 1 :])
    return out
