# SPDX-License-Identifier: Apache-2.0
"""Legs of a well: stretches of hole with stations of their own, each from its tie-on."""

from __future__ import annotations

import dataclasses
import enum

MAIN = "main"


class Origin(enum.StrEnum):
    """Where the tie-on of a leg comes from; the words that people read."""

    WELLHEAD = "wellhead"  #: nobody gave one: the path starts vertically at the depth datum
    GIVEN = "given"  #: depth, direction and position
    WITHOUT_POSITION = "given without a position"  #: depth and direction; the position is made up
    STATION = "first station of the list"
    LEG = "path of the parent leg"
    RECORDED = "the recorded path"


@dataclasses.dataclass(frozen=True)
class TieOn:
    """Where a leg starts. m and rad, in the north of the well; `Origin` says who vouches for it."""

    measured_depth: float = 0.0
    inclination: float = 0.0
    azimuth: float = 0.0
    north: float = 0.0
    east: float = 0.0
    vertical_depth: float = 0.0
    source: Origin = Origin.WELLHEAD

    @classmethod
    def given(
        cls,
        measured_depth: float,
        inclination: float,
        azimuth: float,
        position: tuple[float | None, float | None, float | None] = (None, None, None),
    ) -> TieOn:
        """
        Return the tie-on that a person gave.

        position: north, east and vertical depth, m, None where not given: straight below the wellhead then, which is
        an assumption except at the depth datum itself.
        """
        north, east, down = position
        known = measured_depth == 0.0 or None not in position
        place = (north or 0.0, east or 0.0, measured_depth if down is None else down)
        origin = Origin.GIVEN if known else Origin.WITHOUT_POSITION
        return cls(measured_depth, inclination, azimuth, *place, origin)


@dataclasses.dataclass(frozen=True)
class Leg:
    """A stretch of hole with its own stations; a sidetrack names the leg it leaves."""

    name: str = MAIN
    tie_on: TieOn = dataclasses.field(default_factory=TieOn)
    parent: str = ""
