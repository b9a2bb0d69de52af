# SPDX-License-Identifier: Apache-2.0
"""Words as the surface received them, and the packets in which a tool sends them."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.arrays import Indices
from mwd_sensors.telemetry import combinatorial, meanings
from mwd_sensors.telemetry.combinatorial import SPACING_TU
from mwd_sensors.telemetry.pulse_position import packets, window_tu
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import PULSE_CODES, ToolConfiguration
from mwd_surface.receiver.belief import SURVEY_LEVEL, TOOLFACE_LEVEL, Judged

BELIEVED, ERASED, BY_CONSISTENCY = "believed", "erased", "by_consistency"


@dataclasses.dataclass(frozen=True)
class ReceivedWord:
    """
    One word as received.

    Attributes
    ----------
    start_s, end_s : float
        Time on air at the surface, on the clock of the pressure.
    frame, index : int
        Counts the passes of sequences, from 0, and the words of the pass.
    kind : str
        "survey" or "toolface": the sequence it came in.
    name, unit : str
    raw : int
        Most probable code.
    value : float
        Of that code, in the unit of the word; nan of the code that says that the tool has no measurement.
    confidence : float
        Probability that the code is right.
    sigma : float
        1 sigma of the value if it is right, in the unit of the word.
    status : str
        "believed", or "erased" where the confidence is below the level of its kind or the tool has no measurement,
        or "by_consistency" where the surveys before make one of the codes of an erased word probable enough.
    alternatives : tuple of (int, float)
        Next codes with their probabilities.
    revision : int
        0: provisional, as decoded when it was heard; 1: final, decoded again with the whole pass.
    """

    start_s: float
    end_s: float
    frame: int
    index: int
    kind: str
    name: str
    unit: str
    raw: int
    value: float
    confidence: float
    sigma: float
    status: str
    alternatives: tuple[tuple[int, float], ...]
    revision: int = 1

    @property
    def usable(self) -> bool:
        """Whether its value may be used: it is believed, or chosen by the consistency of its survey."""
        return self.status != ERASED


@dataclasses.dataclass(frozen=True)
class LinkValue:
    """Value and 1 sigma, SI, of a word; code; begin and end on air, s on the clock of the samples; odds of the code."""

    value: float
    sigma: float
    raw: int
    start_s: float
    end_s: float
    confidence: float = 1.0


def believed(words: list[ReceivedWord]) -> dict[str, LinkValue]:
    """Newest believed word of each meaning."""
    found = {}
    for word in words:
        quantity = meanings.meaning_of(word.name)
        if quantity and word.usable:
            found[quantity] = value_of(word)
    return found


def value_of(word: ReceivedWord) -> LinkValue:
    """Value of a word in SI."""
    factor = meanings.factor(word.unit)
    return LinkValue(word.value * factor, word.sigma * factor, word.raw, word.start_s, word.end_s, word.confidence)


@dataclasses.dataclass(frozen=True)
class FrameReport:
    """One pass of a sequence: kind and number, time on air, energy of a bit over noise density, clock error, reason."""

    frame: int
    kind: str
    start_s: float
    end_s: float
    ebn0_db: float
    clock_error: float
    reason: str


@dataclasses.dataclass
class Reception:
    """
    What a block of samples completed.

    Attributes
    ----------
    words : list of ReceivedWord
        Words of passes that are complete: final.
    frames : list of FrameReport
        Those passes.
    provisional : list of ReceivedWord
        Words just heard, `revision` 0; the final one has the same frame and index.
    """

    words: list[ReceivedWord] = dataclasses.field(default_factory=list)
    frames: list[FrameReport] = dataclasses.field(default_factory=list)
    provisional: list[ReceivedWord] = dataclasses.field(default_factory=list)

    def add(self, more: Reception) -> None:
        """Take what another block completed."""
        self.words += more.words
        self.frames += more.frames
        self.provisional += more.provisional


@dataclasses.dataclass(frozen=True)
class WordPlace:
    """Where a word stands: frame, index in it, kind of its sequence, revision."""

    frame: int
    index: int
    kind: str
    revision: int


def received(
    tool: ToolConfiguration, item: SequenceItem, judged: Judged, span: tuple[float, float], place: WordPlace
) -> ReceivedWord:
    """
    Word from its judged codes.

    span: begin and end, s.
    """
    word = tool.table[item.name]
    level = SURVEY_LEVEL if place.kind == "survey" else TOOLFACE_LEVEL
    known = judged.confidence >= level and judged.code != word.missing(item.bits)
    return ReceivedWord(
        *span,
        place.frame,
        place.index,
        place.kind,
        item.name,
        word.unit,
        judged.code,
        word.value(judged.code, item.bits),
        judged.confidence,
        word.sigma_of(item.bits),
        BELIEVED if known else ERASED,
        judged.alternatives,
        place.revision,
    )


def packet_rows(items: tuple[SequenceItem, ...], code: str = "mary") -> tuple[Indices, int]:
    """
    Packets of some words sent one after the other; of the combinatorial code a packet is one pulse.

    code: of the tool.

    Returns
    -------
    ndarray, shape (n, 6)
        As `trellis.forward_backward` takes them.
    int
        Time of all of them, TU.
    """
    rows = []
    at = 0
    for item in items:
        if code == "combinatorial":
            count, slots = combinatorial.shape(item.length)
            values = slots - SPACING_TU * (count - 1)
            rows += [(at + SPACING_TU * k, 0, k == count - 1, 0, values, 1) for k in range(count)]
            at += combinatorial.encode(0, item.length).length
            continue
        sizes = packets(item.length)
        for k, size in enumerate(sizes):
            rows.append((at, size, k == len(sizes) - 1, item.parity, 1 << size, 0))
            at += window_tu(size)
    return np.array(rows, dtype=np.int64).reshape(-1, 6), at


def item_of(word: ReceivedWord, tool: ToolConfiguration) -> SequenceItem:
    """Place of a word in the sequences of the tool."""
    sequences = tool.surveys if word.kind == "survey" else tool.toolfaces
    here = (items[word.index] for items in sequences if word.index < len(items))
    return next((item for item in here if item.name == word.name), SequenceItem(word.name, 2, False))


def pulse_edges(word: ReceivedWord, tool: ToolConfiguration) -> list[float]:
    """Begin of each pulse of the code of a word, s after the word's; none where the tool sends no pulses."""
    item = item_of(word, tool)
    if tool.code not in PULSE_CODES or word.raw >= 1 << item.bits:
        return []
    code = word.raw << 1 | tool.parity_bit(word.raw) if item.parity else word.raw
    sent = tool.pulses(code, item.length)
    # On the clock of the tool as it was received.
    unit = (word.end_s - word.start_s) / sent.length
    return [edge * unit for edge in sent.edges]
