# SPDX-License-Identifier: Apache-2.0
"""
Convention of the hole's vertical angle: inclination from the vertical, or dip from the horizontal.

Inside the program the angle is always the inclination, from 0 (straight down) to pi. People of coal mines and of
trenchless drilling read and write the dip instead. Files, reports, lists and the page convert here and nowhere else;
`page/static/units.js` does the same in the browser.
"""

from __future__ import annotations

import enum
import math
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from mwd_sensors.core.arrays import Array

Angle = TypeVar("Angle", float, "Array")
_RIGHT = math.pi / 2.0


class AngleConvention(enum.StrEnum):
    """Convention in which people state the vertical angle of a hole; the value is its word in the settings."""

    INCLINATION = "inclination"
    DIP_UP = "dip_up"  #: from the horizontal, positive where the hole rises
    DIP_DOWN = "dip_down"  #: from the horizontal, positive where the hole falls

    def shown(self, inclination: Angle) -> Angle:
        """Return the angle to show to people, rad, for an inclination, rad; NaN stays NaN."""
        if self is AngleConvention.INCLINATION:
            return inclination
        return inclination - _RIGHT if self is AngleConvention.DIP_UP else _RIGHT - inclination

    def inclination(self, shown: Angle) -> Angle:
        """Return the inclination, rad, for an angle that people have written in this convention, rad."""
        if self is AngleConvention.INCLINATION:
            return shown
        return shown + _RIGHT if self is AngleConvention.DIP_UP else _RIGHT - shown

    @property
    def sign(self) -> float:
        """Change of the shown angle divided by the change of the inclination: -1 for DIP_DOWN, else 1."""
        return -1.0 if self is AngleConvention.DIP_DOWN else 1.0

    @property
    def points(self) -> str:
        """Direction of positive dips as in the settings of lists, "up" or "down"; empty for inclinations."""
        return {AngleConvention.DIP_UP: "up", AngleConvention.DIP_DOWN: "down"}.get(self, "")

    @property
    def column(self) -> str:
        """Name of the column in files that holds the angle in degrees."""
        return f"hole_{self.value}_deg" if self.points else "inclination_deg"

    @property
    def heading(self) -> str:
        """Short title of the angle's column in reports; never "Dip", which is the title of the magnetic dip."""
        return _TITLES[self]

    @property
    def meaning(self) -> str:
        """Definition of the angle in words, for the heading of lists."""
        return _MEANINGS[self]


_TITLES = {
    AngleConvention.INCLINATION: "Inc",
    AngleConvention.DIP_UP: "Hole dip, up +",
    AngleConvention.DIP_DOWN: "Hole dip, down +",
}
_MEANINGS = {
    AngleConvention.INCLINATION: "inclination from the vertical",
    AngleConvention.DIP_UP: "dip from the horizontal, positive where the hole rises",
    AngleConvention.DIP_DOWN: "dip from the horizontal, positive where the hole falls",
}
CONVENTIONS = tuple(convention.value for convention in AngleConvention)
