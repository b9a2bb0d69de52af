# SPDX-License-Identifier: Apache-2.0
"""Words as received at the surface, and the packets in which a tool sends them."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mwd_sensors.core.arrays import Indices
from mwd_sensors.core.output_files import write_whole
from mwd_sensors.telemetry import meanings
from mwd_sensors.telemetry.pulse_position import encode, packets, window_tu
from mwd_sensors.telemetry.sequences import SequenceItem
from mwd_sensors.telemetry.tool_configuration import ToolConfiguration
from mwd_surface.receiver.belief import SURVEY_LEVEL, TOOLFACE_LEVEL, Judged

BELIEVED, ERASED, BY_CONSISTENCY = "believed", "erased", "by_consistency"


@dataclasses.dataclass(frozen=True)
class ReceivedWord:
    """One received word."""

    #: `start_s`, `end_s`: time on air at the surface, on the clock of the pressure.
    start_s: float
    end_s: float
    #: `frame`, `index`: number of the pass of the sequence (all its words sent once), from 0, and index of the word in
    #: the pass.
    frame: int
    index: int
    kind: str  #: kind of the sequence in which the word came: "survey" or "toolface"
    name: str
    unit: str
    raw: int  #: most probable code of the word
    value: float  #: value of `raw`, in the unit of the word; NaN if `raw` is the code that means "no measurement"
    confidence: float  #: probability that the code is right
    sigma: float  #: 1 sigma of the value if the code is right, in the unit of the word
    #: "believed"; or "erased" if the confidence is below the level for its kind or the tool had no measurement; or
    #: "by_consistency" if earlier surveys make one of the codes of an erased word probable enough.
    status: str
    alternatives: tuple[tuple[int, float], ...]  #: next most probable codes with their probabilities
    revision: int = 1  #: 0: provisional, as first decoded; 1: final, decoded again with the whole pass

    @property
    def usable(self) -> bool:
        """Whether the value may be used: it is believed, or decided by consistency with other surveys."""
        return self.status != ERASED


def no_words(reason: str) -> str:
    """Return the sentence that no word was received, with the reason."""
    return f"no words: {reason}"


@dataclasses.dataclass(frozen=True)
class LinkValue:
    """Value and 1 sigma of a word, SI; code; begin and end, s on the clock of the samples; confidence of the code."""

    value: float
    sigma: float
    raw: int
    start_s: float
    end_s: float
    confidence: float = 1.0


def believed(words: list[ReceivedWord]) -> dict[str, LinkValue]:
    """Return the newest usable word of each meaning, in SI."""
    found = {}
    for word in words:
        quantity = meanings.meaning_of(word.name)
        if quantity and word.usable:
            found[quantity] = value_of(word)
    return found


def value_of(word: ReceivedWord) -> LinkValue:
    """Return the value of a word in SI."""
    factor = meanings.factor(word.unit)
    return LinkValue(word.value * factor, word.sigma * factor, word.raw, word.start_s, word.end_s, word.confidence)


@dataclasses.dataclass(frozen=True)
class FrameReport:
    """Report of one pass of a sequence: number, kind, begin and end, s, energy per bit over noise density, dB."""

    frame: int
    kind: str
    start_s: float
    end_s: float
    ebn0_db: float
    clock_error: float  #: relative error of the tool's clock
    reason: str  #: sentence on what went wrong, empty if nothing did


@dataclasses.dataclass
class Reception:
    """Words, and passes of sequences (frames), that a block of samples completed."""

    words: list[ReceivedWord] = dataclasses.field(default_factory=list)  #: final words, from complete passes
    frames: list[FrameReport] = dataclasses.field(default_factory=list)  #: reports of the complete passes
    #: Words just decoded, with `revision` 0; the final word has the same frame and index.
    provisional: list[ReceivedWord] = dataclasses.field(default_factory=list)

    def add(self, more: Reception) -> None:
        """Append the words and frames of a later block."""
        self.words += more.words
        self.frames += more.frames
        self.provisional += more.provisional


@dataclasses.dataclass(frozen=True)
class WordPlace:
    """Place of a word: frame, index in the frame, kind of its sequence, revision."""

    frame: int
    index: int
    kind: str
    revision: int


def received(
    tool: ToolConfiguration, item: SequenceItem, judged: Judged, span: tuple[float, float], place: WordPlace
) -> ReceivedWord:
    """
    Return a received word, made from its decoded code and the confidence in it.

    span: begin and end of the word, s.
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


def packet_rows(items: tuple[SequenceItem, ...]) -> tuple[Indices, int]:
    """
    Return the packets of words sent one after the other.

    Returns
    -------
    ndarray, shape (n, 5)
        Packets, as in `trellis.forward_backward`.
    int
        Total duration, TU.
    """
    rows = []
    at = 0
    for item in items:
        sizes = packets(item.length)
        for k, size in enumerate(sizes):
            rows.append((at, size, k == len(sizes) - 1, item.parity, 1 << size))
            at += window_tu(size)
    return np.array(rows, dtype=np.int64).reshape(-1, 5), at


def item_of(word: ReceivedWord, tool: ToolConfiguration) -> SequenceItem:
    """Return the sequence item of a word in the tool configuration; an item of 2 bits if there is no such word."""
    sequences = tool.surveys if word.kind == "survey" else tool.toolfaces
    here = (items[word.index] for items in sequences if word.index < len(items))
    return next((item for item in here if item.name == word.name), SequenceItem(word.name, 2, False))


def pulse_edges(word: ReceivedWord, tool: ToolConfiguration) -> list[float]:
    """
    Return the begin of each pulse of a word's code, s after the word's begin.

    The list is empty if the tool sends no pulses, or if the code has more bits than the word.
    """
    item = item_of(word, tool)
    if tool.code != "mary" or word.raw >= 1 << item.bits:
        return []
    code = word.raw << 1 | tool.parity_bit(word.raw) if item.parity else word.raw
    sent = encode(code, item.length)
    # Unit of the tool's clock as received.
    unit = (word.end_s - word.start_s) / sent.length
    return [edge * unit for edge in sent.edges]


# Words and surveys as tables.

WORD_HEADER = (
    "start_s",
    "end_s",
    "frame",
    "name",
    "raw",
    "value",
    "confidence",
    "sigma",
    "status",
    "alternatives",
)


def words_csv(words: Sequence[ReceivedWord], header: bool = True) -> str:
    """
    Return a table of words, one per row; value and sigma are in the unit of the word.

    Alternatives are written as `raw:probability`, separated by blanks. header: whether the first row names the columns.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    if header:
        table.writerow(WORD_HEADER)
    for word in words:
        others = " ".join(f"{raw}:{chance:.4f}" for raw, chance in word.alternatives if chance >= 5e-5)
        table.writerow(
            (
                f"{word.start_s:.3f}",
                f"{word.end_s:.3f}",
                word.frame,
                word.name,
                word.raw,
                "" if math.isnan(word.value) else f"{word.value:.6g}",
                f"{word.confidence:.5f}",
                f"{word.sigma:.4g}",
                word.status,
                others,
            )
        )
    return text.getvalue()


def surveys_csv(words: Sequence[ReceivedWord]) -> str:
    """
    Return a table of surveys: one row each, with a value and a sigma column per word; erased words are empty.

    The last column names the words that were decided by consistency with other surveys.
    """
    frames: dict[int, list[ReceivedWord]] = {}
    for word in words:
        if word.kind == "survey":
            frames.setdefault(word.frame, []).append(word)
    names = list(dict.fromkeys(word.name for frame in frames.values() for word in frame))
    units = {word.name: word.unit for frame in frames.values() for word in frame}
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    columns = [f"{name}_{units[name]}" if units[name] else name for name in names]
    table.writerow(
        ["frame", "start_s", "end_s", *(c for name in columns for c in (name, f"sigma_{name}")), BY_CONSISTENCY]
    )
    for number, frame in frames.items():
        cells = {word.name: (f"{word.value:.6g}", f"{word.sigma:.4g}") for word in frame if word.usable}
        row = [number, f"{frame[0].start_s:.3f}", f"{frame[-1].end_s:.3f}"]
        chosen = " ".join(word.name for word in frame if word.status == BY_CONSISTENCY)
        table.writerow([*row, *(cell for name in names for cell in cells.get(name, ("", ""))), chosen])
    return text.getvalue()


class WordFiles:
    """
    Files words.csv and surveys.csv in a folder, written as words arrive.

    Parameters
    ----------
    folder : Path
        Existing files in it are replaced.

    Raises
    ------
    OSError
        The files cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self._surveys = folder / "surveys.csv"
        self._heard: list[ReceivedWord] = []
        self.count = 0
        self._words = (folder / "words.csv").open("w", encoding="utf-8")
        self._words.write(words_csv([]))
        self._write_surveys()

    def __enter__(self) -> WordFiles:
        """Return the object itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close words.csv; surveys.csv is open only while it is written."""
        self._words.close()

    def add(self, words: Sequence[ReceivedWord]) -> None:
        """Append final words to the files."""
        if not words:
            return
        self.count += len(words)
        self._words.write(words_csv(words, header=False))
        self._words.flush()
        surveys = [word for word in words if word.kind == "survey"]
        if surveys:
            self._heard += surveys
            self._write_surveys()

    def _write_surveys(self) -> None:
        write_whole(self._surveys, surveys_csv(self._heard))
