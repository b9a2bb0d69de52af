# SPDX-License-Identifier: Apache-2.0
"""
Words of a carrier block and their confidence.

The 16-bit check lets one wrong block in 65 536 pass for each trial. The score of the marker tells how probable a block
was before the trials. Words of a block whose check fails keep the confidence that the code gives them, reduced because
the failed check shows at least one wrong bit.
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

# Odds that a block is present where one should follow the last.
ODDS_EXPECTED = 10.0
_PASSES_BY_CHANCE = 2.0**-16
_BLOCKS_PER_SYMBOL = 1e-3  # prior of a block at a place: one in some hundred symbols, with flow half the time
_HEADER_BITS = 8
_ALTERNATIVES = 3
_NO_SURPRISE, _FLATTER = 0.5, 1.25
# Upper bound of the confidence of such words: all phases of the block may be rotated, which the code cannot see.
_MOST_ERASED = 0.9


def odds_of_marker(score: float) -> float:
    """Return the odds that a marker with this score is real; noise exceeds a score x with probability exp(-x)."""
    return min(_BLOCKS_PER_SYMBOL * math.exp(min(score, 50.0)), ODDS_EXPECTED)


def items_of(tool: ToolConfiguration, name: BlockName) -> tuple[SequenceItem, ...]:
    """Return the words of a block; empty where the configuration has no such block."""
    sequences = tool.surveys if name.kind == "survey" else tool.toolfaces
    if name.number >= len(sequences):
        return ()
    blocks = air.blocks_of(sequences[name.number], tool.carrier.block_bits)
    return blocks[name.place] if name.place < len(blocks) else ()


def following(tool: ToolConfiguration, name: BlockName) -> BlockName:
    """Return the next block: the next of the same sequence, else the first of the toolface sequence."""
    after = name._replace(place=name.place + 1)
    if items_of(tool, after):
        return after
    number = name.number if name.kind == "toolface" else max(min(name.number, len(tool.toolfaces) - 1), 0)
    return BlockName("toolface", number, 0)


def checked(tool: ToolConfiguration, bits: Array) -> tuple[BlockName, bytes] | None:
    """Return name and words of a block if its check, name, parities and filling hold, else None; bits as decoded."""
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
    Return the words of a block whose check holds.

    block: its name and the number of its frame; odds: prior odds of the block divided by the number of trials; span:
    its begin and end, s.
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
    """Return the words of a block whose check fails; bits: log posterior ratios; other arguments as in `believed`."""
    name, frame = block
    # The code was sure of this block although its check fails, so the noise is worse than modelled: flatten the
    # probabilities until a failed check is not surprising.
    while _right(bits) > _NO_SURPRISE:
        bits = bits / _FLATTER
    whole = _right(bits)
    words = []
    at = _HEADER_BITS
    for k, item in enumerate(items_of(tool, name)):
        own = bits[at : at + item.bits]
        at += item.length
        # At least one bit of the block is wrong: subtract the case in which all bits are right from the word's
        # probability.
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
    """Return the index of the first word of a block within its sequence."""
    return sum(len(items_of(tool, name._replace(place=place))) for place in range(name.place))


def _right(bits: Array) -> float:
    """Return the probability that all bits are right, taking them as independent."""
    return float(np.exp(-np.sum(np.log1p(np.exp(-np.abs(bits))))))


def _number(bits: Array) -> int:
    return int("".join("1" if bit < 0.0 else "0" for bit in bits), 2)
