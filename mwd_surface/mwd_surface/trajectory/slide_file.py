# SPDX-License-Identifier: Apache-2.0
"""
Slide sheet on disk: one line of JSON per finished stretch of hole (slid or rotated), flushed to disk at once.

A recording contains the slide sheet as it was at the beginning of the recording, as a table of such lines.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from mwd_sensors.core import budgets, settings
from mwd_sensors.core.input_files import load_json, read_file
from mwd_surface.trajectory.slide_sheet import DrilledStretch

NAME = "slides.jsonl"
SLIDES = "slide_sheet"  # name of the table in a recording
_ROWS = "stretches"


def read_stretches(path: Path) -> tuple[tuple[DrilledStretch, ...], int]:
    """
    Return the slid and rotated stretches of a slide sheet, and the number of invalid lines.

    Without a file there are no stretches. Raises OSError if the file cannot be read or is too large.
    """
    text = read_file(path, budgets.JSON).decode(errors="replace") if path.is_file() else ""
    return _stretches(text)


def stretch_table(stretches: Iterable[DrilledStretch]) -> dict[str, str]:
    """Return the table that stores these stretches at the beginning of a recording."""
    return {_ROWS: "\n".join(json.dumps(settings.to_mapping(one)) for one in stretches)}


def recorded_stretches(table: Mapping[str, str]) -> tuple[DrilledStretch, ...]:
    """Return the stretches in the slide sheet's table of a recording; empty if the table is empty."""
    return _stretches(table.get(_ROWS, ""))[0]


def _stretches(text: str) -> tuple[tuple[DrilledStretch, ...], int]:
    found, bad = [], 0
    for line in text.splitlines():
        try:
            found.append(settings.from_mapping(DrilledStretch, load_json(line), "stretch"))
        except ValueError:
            # A power cut in the middle of a line damages only that line.
            bad += 1
    return tuple(found), bad


def append_stretch(path: Path, stretch: DrilledStretch) -> None:
    """
    Append a stretch to the file.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(settings.to_mapping(stretch))
    with path.open("a+b") as file:
        # Start a new line if the last line was cut off, so that it does not damage the new line.
        if file.seek(0, os.SEEK_END) and (file.seek(-1, os.SEEK_END), file.read(1))[1] != b"\n":
            text = "\n" + text
        file.write(text.encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())
