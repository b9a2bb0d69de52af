# SPDX-License-Identifier: Apache-2.0
"""Received words and surveys as CSV files."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from mwd_sensors.core.output_files import write_whole
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
