# SPDX-License-Identifier: Apache-2.0
"""Legs of a well: sections of hole with their own stations, each starting at its tie-on."""

from __future__ import annotations

import dataclasses
import enum

MAIN = "main"


class Origin(enum.StrEnum):
    """Origin of a leg's tie-on; the value of each member is its text for users."""

    WELLHEAD = "wellhead"  #: no tie-on was given: the path starts vertically at the depth datum
    GIVEN = "given"  #: depth, direction and position were given
    WITHOUT_POSITION = "given without a position"  #: depth and direction were given; the position is assumed
    STATION = "first station of the list"
    LEG = "path of the parent leg"
    RECORDED = "the recorded path"


@dataclasses.dataclass(frozen=True)
class TieOn:
    """Start of a leg: depth and position in m, angles in rad; azimuth and position refer to the north of the well."""

    measured_depth: float = 0.0
    inclination: float = 0.0
    azimuth: float = 0.0
    north: float = 0.0
    east: float = 0.0
    vertical_depth: float = 0.0
    source: Origin = Origin.WELLHEAD  #: origin of the tie-on

    @classmethod
    def given(
        cls,
        measured_depth: float,
        inclination: float,
        azimuth: float,
        position: tuple[float | None, float | None, float | None] = (None, None, None),
    ) -> TieOn:
        """
        Return a tie-on given by a person.

        measured_depth: m. inclination, azimuth: rad. position: north, east and vertical depth, m, None if not given. A
        missing value is taken from a point straight below the wellhead; the position is then marked as assumed, except
        at measured depth 0.
        """
        north, east, down = position
        known = measured_depth == 0.0 or None not in position
        place = (north or 0.0, east or 0.0, measured_depth if down is None else down)
        origin = Origin.GIVEN if known else Origin.WITHOUT_POSITION
        return cls(measured_depth, inclination, azimuth, *place, origin)


@dataclasses.dataclass(frozen=True)
class Leg:
    """A section of hole with its own stations."""

    name: str = MAIN
    tie_on: TieOn = dataclasses.field(default_factory=TieOn)
    parent: str = ""  #: name of the leg from which this leg branches off; empty for the main leg
