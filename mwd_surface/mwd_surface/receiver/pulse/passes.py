# SPDX-License-Identifier: Apache-2.0
"""
One pass of a sequence: all its words sent once.

Each stretch of words is decoded as it arrives, and again when the pass is complete.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_sensors.core.arrays import Array, Indices
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.belief import Candidate, Soft
from mwd_surface.receiver.pulse import segment, trellis
from mwd_surface.receiver.pulse.channel_estimate import SAMPLES_PER_TU, pulse_places
from mwd_surface.receiver.words import packet_rows

_LEAST_CHANCE = 1e-3  # probability above which a place of a pulse is kept
# Smallest number of bits of a stretch: short words are decoded together. A survey word is long enough alone, so it is
# shown as soon as it has arrived.
_STRETCH_BITS = 12
# Bits used to decide whether a sequence is present, and which one.
LOOK_BITS = 30
_BEAM = 16  # number of the most probable codes of a word that are kept
# Likelihoods are raised to 1 / temperature (C. Guo et al., On Calibration of Modern Neural Networks, 2017): the first
# in steady noise, the second in a disturbance. A disturbance is not just larger noise: it has a shape that may look
# like a pulse. Against known words, the best temperature is 1 in undisturbed white noise and in wells, and 2 to 3 in
# stalls, whatever share of the word they cover.
_TEMPERATURES = (1.0, 2.5)
# Lowest probability of a parity that floating point distinguishes from 0.
_LEAST = tuple(1e-15 ** (1.0 / temperature) for temperature in _TEMPERATURES)


@dataclasses.dataclass
class DecodedWord:
    """A decoded word of a pass, as estimated so far."""

    item: SequenceItem
    rows: Indices  #: shape (k, 5); packets of the word, as in `trellis.forward_backward`
    at: int  #: first sample of the word in the transmission
    length: int  #: duration, TU
    probability: Array  #: shape (k, values); probability of each value of each packet
    present: Array  #: shape (k, values); probability that the pulse of each value is present
    soft: Soft
    ebn0_db: float
    pulses: bool = True  #: whether any pulses were found in the word

    def places(self) -> Array:
        """Return the probable places of the pulses of the word, as `pulse_places`; none if it has no pulses."""
        least = _LEAST_CHANCE if self.pulses else math.inf
        return pulse_places(self.rows, self.probability * self.present, self.at, least)


@dataclasses.dataclass
class Pass:
    """A pass of a sequence that is being received."""

    kind: str  #: "survey" or "toolface"
    items: tuple[SequenceItem, ...]
    start: int  #: first sample of the transmission
    done: int = 0  #: number of decoded words
    at: int = 0  #: sample at which the next word begins
    parts: list[DecodedWord] = dataclasses.field(default_factory=list)
    shown: int = 0  #: number of words already reported as provisional

    @property
    def complete(self) -> bool:
        """Whether all words of the pass are decoded."""
        return self.done == len(self.items)

    @property
    def heard(self) -> list[DecodedWord]:
        """Words decoded so far in which pulses were found."""
        return [part for part in self.parts if part.pulses]

    def following(self) -> tuple[SequenceItem, ...]:
        """Return the words to decode next."""
        return stretch_of(self.items, self.done)

    def take_back(self, words: int) -> int:
        """Mark the last words as having no pulses; return the sample at which they begin."""
        silent = self.parts[max(len(self.parts) - words, 0) :]
        for part in silent:
            part.pulses = False
        return silent[0].at if silent else self.at

    def add(self, items: tuple[SequenceItem, ...], decision: segment.DecodedStretch, soft: list[Soft]) -> None:
        """Append the next decoded words."""
        self.parts += parts_of(items, decision, soft, self.at)
        self.done += len(items)
        self.at = self.parts[-1].at + SAMPLES_PER_TU * self.parts[-1].length


def parts_of(
    items: tuple[SequenceItem, ...], decision: segment.DecodedStretch, soft: list[Soft], at: int
) -> list[DecodedWord]:
    """Return the decoded words; at: their first sample in the transmission."""
    parts = []
    first = 0
    for item, one in zip(items, soft, strict=True):
        rows, length = packet_rows((item,))
        mine = slice(first, first + len(rows))
        parts.append(
            DecodedWord(
                *(item, rows, at, length, decision.probability[mine], decision.present[mine], one),
                float(decision.ebn0_db[first]),
            )
        )
        first += len(rows)
        at += SAMPLES_PER_TU * length
    return parts


def stretch_of(items: tuple[SequenceItem, ...], done: int, least: int = _STRETCH_BITS) -> tuple[SequenceItem, ...]:
    """
    Return the next words of a sequence, after the first `done`, with at least `least` bits together.

    A remainder of the sequence with less than half of these bits is included.
    """
    bits, end = 0, done
    while end < len(items) and bits < least:
        bits += items[end].length
        end += 1
    if sum(item.length for item in items[end:]) < least // 2:
        end = len(items)
    return items[done:end]


def sync_places(tool: ToolConfiguration, start: int) -> Array:
    """Return the places of the pulses of a sync that starts at the sample `start`, as `pulse_places`."""
    at = float(start) + SAMPLES_PER_TU * np.array(tool.sync.edges_tu)
    return np.column_stack([at, np.ones(len(at)), at])


def rows_from_sync(tool: ToolConfiguration, items: tuple[SequenceItem, ...]) -> tuple[Indices, int]:
    """Return the packets of a sync, its header and the words after it, and their duration, TU."""
    sync, bits = tool.sync, tool.header_bits
    rows, length = packet_rows((SequenceItem("header", bits, False), *items) if bits else items)
    rows[:, trellis.START] += sync.length_tu
    # Sync pulses are packets with a single value, because their places are known.
    fixed = [(edge, 0, 1, 0, 1) for edge in sync.edges_tu]
    return np.concatenate([np.array(fixed), rows]), sync.length_tu + length


def soft_words(
    decision: segment.DecodedStretch, rows: Indices, items: tuple[SequenceItem, ...], parity: int
) -> list[Soft]:
    """Return the words with the probabilities of their most probable codes; parity: 0 even, 1 odd."""
    ends = np.flatnonzero(rows[:, trellis.ENDS])
    firsts = np.concatenate([[0], ends[:-1] + 1])
    holds = np.empty((len(items), len(_TEMPERATURES)))
    codes: list[dict[int, list[float]]] = [{} for _ in items]
    for t, temperature in enumerate(_TEMPERATURES):
        given = (rows, decision.unary / temperature, decision.common / temperature, decision.level)
        _, even, _ = trellis.marginals(rows, *trellis.forward_backward(*given, -1))
        holds[:, t] = even[ends] if parity == 0 else 1.0 - even[ends]
        sums = trellis.forward_backward(*given, parity)
        _, _, evidence = trellis.marginals(rows, *sums)
        for k, item in enumerate(items):
            for code, log in trellis.best_words(*given, *sums, int(firsts[k]), _BEAM).tolist():
                value = int(code) >> 1 if item.parity else int(code)
                codes[k].setdefault(value, [0.0] * len(_TEMPERATURES))[t] += math.exp(min(log - evidence, 0.0))
    chances = [np.array(list(one.values())).T for one in codes]
    # A wrong table has the same kind of pulses in all packets of a word.
    fits = np.add.reduceat(decision.fits, firsts)
    least = fits.min(axis=1)
    # Log likelihood ratio of the table to all wrong tables.
    worst = least - np.log(np.mean(np.exp(least[:, None] - fits), axis=1))
    return [
        _mixed(list(codes[k]), chances[k], holds[k] if item.parity else None, decision.disturbed[firsts[k]], worst[k])
        for k, item in enumerate(items)
    ]


def _mixed(codes: list[int], chances: Array, holds: Array | None, disturbed: float, fits: float) -> Soft:
    """
    Return the word with code probabilities averaged over two noises: steady noise and a disturbance.

    chances, shape (2, codes): probability of each code in steady noise and in a disturbance. holds, shape (2,): as in
    `Soft`; None without a parity. disturbed: probability of a disturbance; a parity that probably fails raises it.
    fits: as in `Soft`.
    """
    shares = np.array([1.0 - disturbed, disturbed])
    # A parity that probably fails is evidence for a disturbance of this word.
    given = shares if holds is None else shares * np.maximum(holds, _LEAST)
    found = given / given.sum() @ chances
    candidates = tuple(map(Candidate, codes, found.tolist()))
    return Soft(candidates, None if holds is None else float(shares @ holds), float(fits))
