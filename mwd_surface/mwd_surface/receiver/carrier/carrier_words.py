# SPDX-License-Identifier: Apache-2.0
"""
Words of a block on a carrier, and how far they are to be believed.

The check of 16 bits lets one wrong block in 65 536 pass for each time it is tried; how probable a block was before it
was tried is known from its marker. Words of a block whose check fails keep what the code says of them, less what the
failing check takes away.
"""

from __future__ import annotations

import math

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_sensors.telemetry import carrier as air
from mwd_sensors.telemetry.carrier import BlockName
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.belief import Judged
from mwd_surface.receiver.words import ReceivedWord, WordPlace, received

# Odds that a block is there, to its check: where one should follow another one.
ODDS_EXPECTED = 10.0
_PASSES_BY_CHANCE = 2.0**-16
_BLOCKS_PER_SYMBOL = (
    1e-3  # blocks in places where nothing is known: one in some hundred symbols, with flow half the time
)
_HEADER_BITS = 8
_ALTERNATIVES = 3
_NO_SURPRISE, _FLATTER = 0.5, 1.25
# Words of such a block are right at most so often: all of its phases may be turned, which the code does not see.
_MOST_ERASED = 0.9


def odds_of_marker(score: float) -> float:
    """Odds that a marker of a score is one; noise exceeds a score x with probability exp(-x)."""
    return min(_BLOCKS_PER_SYMBOL * math.exp(min(score, 50.0)), ODDS_EXPECTED)


def items_of(tool: ToolConfiguration, name: BlockName) -> tuple[SequenceItem, ...]:
    """Words of a block; none where the configuration has no such block."""
    sequences = tool.surveys if name.kind == "survey" else tool.toolfaces
    if name.number >= len(sequences):
        return ()
    blocks = air.blocks_of(sequences[name.number], tool.carrier.block_bits)
    return blocks[name.place] if name.place < len(blocks) else ()


def following(tool: ToolConfiguration, name: BlockName) -> BlockName:
    """Block that follows another one: the next of its sequence, or the first of the toolface sequence."""
    after = name._replace(place=name.place + 1)
    if items_of(tool, after):
        return after
    number = name.number if name.kind == "toolface" else min(name.number, len(tool.toolfaces) - 1)
    return BlockName("toolface", number, 0)


def checked(tool: ToolConfiguration, bits: Array) -> tuple[BlockName, bytes] | None:
    """Name and words of a block whose check, name, parities and filling hold; bits as the decoder gives them."""
    block = air.read_block((bits < 0.0).astype(np.int64), tool.table_check)
    if block is None:
        return None
    items = items_of(tool, block[0])
    lengths = [item.length for item in items]
    sent = air.unpacked(block[1], lengths)
    filled = air.packed(sent, lengths, tool.carrier.block_bits) == block[1]
    holds = all(tool.parity_bit(code >> 1) == code & 1 for code, item in zip(sent, items, strict=True) if item.parity)
    return block if items and filled and holds else None


def believed(
    tool: ToolConfiguration, block: tuple[BlockName, int], data: bytes, odds: float, span: tuple[float, float]
) -> list[ReceivedWord]:
    """
    Words of a block whose check holds.

    block: its name and the number of the frame; odds: that it was there, over the number of trials; span: begin and
    end, s.
    """
    name, frame = block
    confidence = 1.0 / (1.0 + _PASSES_BY_CHANCE / odds)
    items = items_of(tool, name)
    words = []
    for k, (item, sent) in enumerate(zip(items, air.unpacked(data, [one.length for one in items]), strict=True)):
        code = sent >> 1 if item.parity else sent
        place = WordPlace(frame, _index(tool, name) + k, name.kind, 1)
        words.append(received(tool, item, Judged(code, confidence, ()), span, place))
    return words


def erased(
    tool: ToolConfiguration, block: tuple[BlockName, int], bits: Array, span: tuple[float, float]
) -> list[ReceivedWord]:
    """Words of a block whose check fails; bits: log posterior ratios as the decoder gives them; else as `believed`."""
    name, frame = block
    # A block claimed to be right whose check fails was met by noise that the model does not know: its probabilities
    # are flattened until the failure is no surprise.
    while _right(bits) > _NO_SURPRISE:
        bits = bits / _FLATTER
    whole = _right(bits)
    words = []
    at = _HEADER_BITS
    for k, item in enumerate(items_of(tool, name)):
        own = bits[at : at + item.bits]
        at += item.length
        # One bit at least is wrong somewhere: the word is right if all its bits are, and others are not.
        confidence = _MOST_ERASED * max(_right(own) - whole, 0.0) / max(1.0 - whole, 1e-9)
        code = _number(own)
        weakest = np.argsort(np.abs(own), kind="stable")[:_ALTERNATIVES]
        others = tuple(
            (code ^ 1 << int(item.bits - 1 - bit), float(confidence * math.exp(-abs(own[bit])))) for bit in weakest
        )
        place = WordPlace(frame, _index(tool, name) + k, name.kind, 1)
        words.append(received(tool, item, Judged(code, confidence, others), span, place))
    return words


def _index(tool: ToolConfiguration, name: BlockName) -> int:
    """Place of the first word of a block in its sequence."""
    return sum(len(items_of(tool, name._replace(place=place))) for place in range(name.place))


def _right(bits: Array) -> float:
    """Probability that all bits are right, each by itself."""
    return float(np.exp(-np.sum(np.log1p(np.exp(-np.abs(bits))))))


def _number(bits: Array) -> int:
    return int("".join("1" if bit < 0.0 else "0" for bit in bits), 2)
