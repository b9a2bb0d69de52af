# SPDX-License-Identifier: Apache-2.0
"""
Slide sheet: stretches of hole that were slid (with toolface) or rotated, their file, and the yield of the slides.

New hole is the increase of the hole depth. New hole was slid or rotated according to the rotary speed at the time. A
stretch shorter than `least_length` becomes part of an adjacent stretch. Depths are in m along the hole at the bit,
angles in rad, stamps in ns.

The file has one line of JSON per finished stretch, flushed to disk at once. A recording contains the slide sheet as it
was at the beginning of the recording, as a table of such lines.
"""

from __future__ import annotations

import cmath
import dataclasses
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from mwd_sensors.core import budgets, settings
from mwd_sensors.core.input_files import load_json, read_file
from mwd_sensors.core.settings import setting
from mwd_surface.trajectory.well_path import Definitive

SLIDE, ROTATE = "slide", "rotate"
_LONGEST_STEP = 30.0  # largest step between two readings of the hole depth that counts as drilling, m


@dataclasses.dataclass(frozen=True)
class SlideRules:
    """Limits that separate sliding from rotating, and the shortest stretch."""

    rotating_above: float = setting(
        10.0,
        "Rotary speed above which the string counts as rotating. Raise it if sensor noise shows rotation at rest.",
        unit="r/min",
        low=0.1,
    )
    least_length: float = setting(
        0.5,
        "Shortest interval on the slide sheet. A shorter one is added to its neighbours.",
        unit="m",
        low=0.0,
        high=10.0,
    )


@dataclasses.dataclass(frozen=True)
class DrilledStretch:
    """
    Stretch of hole that was drilled in one mode.

    Raises
    ------
    ValueError
        `mode` is neither SLIDE nor ROTATE.
    """

    mode: str  #: SLIDE or ROTATE
    #: `from_depth`, `to_depth`: depths of the bit, m
    from_depth: float
    to_depth: float
    #: `begin_ns`, `end_ns`: begin and end of drilling, ns since the epoch
    begin_ns: int
    end_ns: int
    #: mean toolface over the metres slid, rad; None for ROTATE, or if no toolface was known
    toolface: float | None = None
    #: length of the mean unit vector of the toolfaces: 1 if the toolface was constant, 0 if evenly scattered
    steadiness: float | None = None
    magnetic: bool = False  #: whether the toolface is from north instead of the high side
    rotary_speed: float = 0.0  #: mean rotary speed over the metres drilled, rad/s

    def __post_init__(self) -> None:
        if self.mode not in (SLIDE, ROTATE):
            raise ValueError(f"mode: {self.mode!r} is neither {SLIDE} nor {ROTATE}")

    @property
    def length(self) -> float:
        """Length of the stretch, m."""
        return self.to_depth - self.from_depth


@dataclasses.dataclass(frozen=True)
class Yield:
    """Drilling between two stations: their measured depths, lengths slid and rotated, m, and the dogleg, rad."""

    from_depth: float
    to_depth: float
    slid: float
    rotated: float
    dogleg: float

    @property
    def motor(self) -> float | None:
        """Dogleg per metre slid, rad/m; None if less than a metre was slid."""
        return self.dogleg / self.slid if self.slid >= 1.0 else None


@dataclasses.dataclass
class _Open:
    """Stretch that has not ended, with sums of speed and toolface weighted by the metres drilled."""

    mode: str
    from_depth: float
    begin_ns: int
    to_depth: float
    end_ns: int
    turns: float = 0.0
    faces: complex = 0j
    faced: float = 0.0
    magnetic: float = 0.0

    def closed(self) -> DrilledStretch:
        """Return this stretch as a row of the slide sheet, with the mean rotary speed and the mean toolface."""
        length = self.to_depth - self.from_depth
        known = self.mode == SLIDE and self.faced > 0.0 and abs(self.faces) > 0.0
        return DrilledStretch(
            self.mode,
            self.from_depth,
            self.to_depth,
            self.begin_ns,
            self.end_ns,
            toolface=cmath.phase(self.faces) % math.tau if known else None,
            steadiness=min(1.0, abs(self.faces) / self.faced) if known else None,
            magnetic=self.magnetic > self.faced / 2.0,
            rotary_speed=self.turns / length if length > 0.0 else 0.0,
        )


class SlideSheet:
    """
    Recorder of stretches, in the order in which they were drilled.

    Parameters
    ----------
    earlier : sequence of DrilledStretch
        Stretches drilled before, read from a file.
    """

    def __init__(self, rules: SlideRules | None = None, earlier: Sequence[DrilledStretch] = ()) -> None:
        self.rules = rules or SlideRules()
        self._done = list(earlier)
        self._open: _Open | None = None
        self._next: _Open | None = None
        self._depth: float | None = max((s.to_depth for s in earlier), default=None)

    def update(
        self,
        stamp_ns: int,
        hole_depth: float,
        rotary_speed: float,
        toolface: float | None = None,
        *,
        magnetic: bool = False,
    ) -> DrilledStretch | None:
        """
        Process one reading; return a stretch that ended with it, or None.

        Parameters
        ----------
        hole_depth : float
            Hole depth, m; if it has not increased, nothing was drilled.
        rotary_speed : float
            Rotary speed of the string, rad/s.
        toolface : float or None
            Toolface, rad; None: unknown.
        magnetic : bool
            Whether the toolface is measured from north.
        """
        if not (math.isfinite(hole_depth) and hole_depth >= 0.0 and math.isfinite(rotary_speed)):
            return None
        if self._depth is None or hole_depth - self._depth > _LONGEST_STEP:
            # This is the first reading, or the new hole was drilled while nothing was recorded: it belongs to no
            # stretch.
            self._depth = hole_depth
            return self.finish()
        made = hole_depth - self._depth
        if made <= 0.0:
            return None
        mode = ROTATE if abs(rotary_speed) > self.rules.rotating_above * math.pi / 30.0 else SLIDE
        if self._open is None:
            self._open = _Open(mode, self._depth, stamp_ns, self._depth, stamp_ns)
        if mode == self._open.mode and self._next is not None:
            # The other mode lasted for less than the shortest stretch: add its hole to the present stretch.
            self._grow(self._open, stamp_ns, self._next.to_depth, self._next.turns, None, False)
            self._next = None
        if mode != self._open.mode and self._next is None:
            self._next = _Open(mode, self._depth, stamp_ns, self._depth, stamp_ns)
        at_hand = self._open if self._next is None else self._next
        face = toolface if mode == SLIDE else None
        self._grow(at_hand, stamp_ns, hole_depth, rotary_speed * made, face, magnetic)
        self._depth = hole_depth
        if self._next is not None and self._next.to_depth - self._next.from_depth >= self.rules.least_length:
            if self._open.to_depth - self._open.from_depth < self.rules.least_length:
                # The ended stretch is too short to be listed, so it becomes part of the next stretch.
                self._next.from_depth, self._next.begin_ns = self._open.from_depth, self._open.begin_ns
                self._open, self._next = self._next, None
                return None
            ended, self._open, self._next = self._open.closed(), self._next, None
            self._done.append(ended)
            return ended
        return None

    def forget_depth(self) -> None:
        """Ignore the change of depth up to the next reading, because a person has corrected the depth."""
        self._depth = None

    @property
    def stretches(self) -> tuple[DrilledStretch, ...]:
        """All stretches, with the present one last."""
        return (*self._done, *([self._open.closed()] if self._open is not None else []))

    def finish(self) -> DrilledStretch | None:
        """End the present stretch, for example at shutdown; return the stretch, or None if its length is zero."""
        if self._open is None:
            return None
        if self._next is not None:
            # The last change of mode is shorter than the shortest stretch: add its hole to the present stretch.
            self._grow(self._open, self._next.end_ns, self._next.to_depth, self._next.turns, None, False)
        ended = self._open.closed()
        self._open = self._next = None
        if ended.length <= 0.0:
            return None
        self._done.append(ended)
        return ended

    @staticmethod
    def _grow(stretch: _Open, stamp_ns: int, depth: float, turns: float, face: float | None, magnetic: bool) -> None:
        made = depth - stretch.to_depth
        stretch.to_depth, stretch.end_ns = depth, stamp_ns
        stretch.turns += turns
        if face is not None:
            stretch.faces += cmath.rect(made, face)
            stretch.faced += made
            stretch.magnetic += made if magnetic else 0.0


def yields(stretches: Sequence[DrilledStretch], path: Definitive) -> tuple[Yield, ...]:
    """
    Return the lengths slid and rotated in each interval between surveys, with the dogleg of the interval.

    The dogleg includes the tendency of the formation. Intervals without recorded drilling are omitted.
    """
    found = []
    for k in range(1, len(path.md)):
        if path.kind[k] != "survey":
            continue
        low, high = float(path.md[k - 1]), float(path.md[k])
        made = {SLIDE: 0.0, ROTATE: 0.0}
        for s in stretches:
            made[s.mode] += max(0.0, min(high, s.to_depth) - max(low, s.from_depth))
        if made[SLIDE] + made[ROTATE] > 0.0:
            dogleg = float(path.dogleg_severity[k]) * (high - low)
            found.append(Yield(low, high, made[SLIDE], made[ROTATE], dogleg))
    return tuple(found)


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
