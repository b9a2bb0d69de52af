# SPDX-License-Identifier: Apache-2.0
"""The slide sheet on disk: a line of JSON for each stretch that ended, durable before the next one matters."""

from __future__ import annotations

import json
import os
from pathlib import Path

from mwd_sensors.core import budgets, settings
from mwd_sensors.core.input_files import load_json, read_file
from mwd_surface.trajectory.slide_sheet import Stretch

NAME = "slides.jsonl"


def read_stretches(path: Path) -> tuple[tuple[Stretch, ...], int]:
    """Stretches of a file, and how many of its lines were no such; no file is an empty sheet."""
    found, bad = [], 0
    lines = read_file(path, budgets.JSON).decode(errors="replace").splitlines() if path.is_file() else []
    for line in lines:
        try:
            found.append(settings.from_mapping(Stretch, load_json(line), "stretch"))
        except ValueError:
            # A supply that failed in the middle of a line: the others are good.
            bad += 1
    return tuple(found), bad


def append_stretch(path: Path, stretch: Stretch) -> None:
    """
    Put a stretch at the end of the file.

    Raises
    ------
    OSError
        The disk refuses.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(settings.to_mapping(stretch))
    with path.open("a+b") as file:
        # A line that was cut off must not take this one with it.
        if file.seek(0, os.SEEK_END) and (file.seek(-1, os.SEEK_END), file.read(1))[1] != b"\n":
            text = "\n" + text
        file.write(text.encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())
