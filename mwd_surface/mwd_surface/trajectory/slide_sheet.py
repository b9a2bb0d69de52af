# SPDX-License-Identifier: Apache-2.0
"""
The slide sheet: which stretches of hole were slid, at which toolface, which were rotated, and what the slides gave.

New hole is what the hole depth grows by. It belongs to the way the string turned meanwhile; a stretch shorter than
`least_length` is part of the one around it. Depths are m along the hole at the bit, angles rad, stamps ns.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
from collections.abc import Sequence

from mwd_sensors.core.settings import setting
from mwd_surface.trajectory.well_path import Definitive

SLIDE, ROTATE = "slide", "rotate"
_LONGEST_STEP = 30.0  # m; a hole that is suddenly so much deeper was not drilled just now


@dataclasses.dataclass(frozen=True)
class SlideRules:
    """What counts as sliding and as a stretch."""

    rotating_above: float = setting(
        10.0,
        "rotary speed above which the string counts as rotating; raise it where a noisy sensor reads a standing string",
        unit="r/min",
        low=0.1,
    )
    least_length: float = setting(
        0.5,
        "shortest interval of its own on the slide sheet; a shorter one is added to its neighbours",
        unit="m",
        low=0.0,
        high=10.0,
    )


@dataclasses.dataclass(frozen=True)
class Stretch:
    """
    New hole made in one way.

    Attributes
    ----------
    mode : str
        SLIDE or ROTATE.
    from_depth, to_depth : float
        m.
    begin_ns, end_ns : int
        When.
    toolface : float or None
        Mean over the metres slid, rad; None while rotating or where none was known.
    steadiness : float or None
        Length of the mean of the toolfaces' unit vectors: 1 held still, 0 all over the place.
    magnetic : bool
        The toolface counts from north, not from the high side.
    rotary_speed : float
        Mean over the metres, rad/s.

    Raises
    ------
    ValueError
        `mode` is neither.
    """

    mode: str
    from_depth: float
    to_depth: float
    begin_ns: int
    end_ns: int
    toolface: float | None = None
    steadiness: float | None = None
    magnetic: bool = False
    rotary_speed: float = 0.0

    def __post_init__(self) -> None:
        if self.mode not in (SLIDE, ROTATE):
            raise ValueError(f"mode: {self.mode!r} is neither {SLIDE} nor {ROTATE}")

    @property
    def length(self) -> float:
        """Length of the stretch, m."""
        return self.to_depth - self.from_depth


@dataclasses.dataclass(frozen=True)
class Yield:
    """What was drilled between two surveys: metres slid and rotated, and the dogleg that came of it, rad."""

    from_depth: float
    to_depth: float
    slid: float
    rotated: float
    dogleg: float

    @property
    def motor(self) -> float | None:
        """Dogleg per metre slid, rad/m; None where next to nothing was slid."""
        return self.dogleg / self.slid if self.slid >= 1.0 else None


@dataclasses.dataclass
class _Open:
    """The stretch at hand, in sums over metres."""

    mode: str
    from_depth: float
    begin_ns: int
    to_depth: float
    end_ns: int
    turns: float = 0.0
    faces: complex = 0j
    faced: float = 0.0
    magnetic: float = 0.0

    def closed(self) -> Stretch:
        """As a value."""
        length = self.to_depth - self.from_depth
        known = self.mode == SLIDE and self.faced > 0.0 and abs(self.faces) > 0.0
        return Stretch(
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
    Stretches in the order in which they were drilled.

    earlier : sequence of Stretch
        From before, as a file kept them.
    """

    def __init__(self, rules: SlideRules | None = None, earlier: Sequence[Stretch] = ()) -> None:
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
    ) -> Stretch | None:
        """
        Take one reading; a stretch that ended with it comes back.

        Parameters
        ----------
        stamp_ns : int
        hole_depth : float
            m. Not deeper than before: nothing was drilled.
        rotary_speed : float
            Of the string, rad/s.
        toolface : float or None
            rad, where it is known.
        magnetic : bool
            It counts from north.
        """
        if not (math.isfinite(hole_depth) and hole_depth >= 0.0 and math.isfinite(rotary_speed)):
            return None
        if self._depth is None or hole_depth - self._depth > _LONGEST_STEP:
            # The first word of the rig, or hole that somebody else made: it is nobody's slide.
            self._depth = hole_depth
            return self.finish()
        made = hole_depth - self._depth
        if made <= 0.0:
            return None
        mode = ROTATE if abs(rotary_speed) > self.rules.rotating_above * math.pi / 30.0 else SLIDE
        if self._open is None:
            self._open = _Open(mode, self._depth, stamp_ns, self._depth, stamp_ns)
        if mode == self._open.mode and self._next is not None:
            # It was but a moment of the other way.
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
                # Too short to stand alone: what comes after takes it in.
                self._next.from_depth, self._next.begin_ns = self._open.from_depth, self._open.begin_ns
                self._open, self._next = self._next, None
                return None
            ended, self._open, self._next = self._open.closed(), self._next, None
            self._done.append(ended)
            return ended
        return None

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        """All of them, the one at hand last."""
        return (*self._done, *([self._open.closed()] if self._open is not None else []))

    def finish(self) -> Stretch | None:
        """End the stretch at hand, as where nobody will look on any longer; it comes back where it has a length."""
        if self._open is None:
            return None
        if self._next is not None:
            # A moment of the other way that nobody saw the end of.
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


def yields(stretches: Sequence[Stretch], path: Definitive) -> tuple[Yield, ...]:
    """
    What each surveyed interval was drilled like, and the dogleg the surveys found there.

    The tendency of the formation is in the dogleg too; intervals in which nothing was recorded are left out.
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
