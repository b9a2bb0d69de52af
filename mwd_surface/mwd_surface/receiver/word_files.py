"""Words and surveys as the surface received them, as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from mwd_surface.receiver.words import BY_CONSISTENCY, ReceivedWord

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


def words_csv(words: Sequence[ReceivedWord]) -> str:
    """
    Table of all words, one a row; value and sigma in the unit of the word.

    Alternatives are `raw:probability`, separated by blanks.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
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
                f"{word.value:.6g}",
                f"{word.confidence:.5f}",
                f"{word.sigma:.4g}",
                word.status,
                others,
            )
        )
    return text.getvalue()


def surveys_csv(words: Sequence[ReceivedWord]) -> str:
    """
    Table of the surveys: a row for each, a column and a sigma for each word; a word that was erased is empty.

    The last column names the words that the survey's consistency chose.
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
