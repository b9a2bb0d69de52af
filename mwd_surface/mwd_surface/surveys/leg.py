# SPDX-License-Identifier: Apache-2.0
"""Legs of a well: stretches of hole with stations of their own, each from its tie-on."""

from __future__ import annotations

import dataclasses

MAIN = "main"


@dataclasses.dataclass(frozen=True)
class TieOn:
    """Where a leg starts: a station that is taken as given. m and rad, in the north of the well."""

    measured_depth: float = 0.0
    inclination: float = 0.0
    azimuth: float = 0.0
    north: float = 0.0
    east: float = 0.0
    vertical_depth: float = 0.0
    source: str = "wellhead"


@dataclasses.dataclass(frozen=True)
class Leg:
    """A stretch of hole with its own stations; a sidetrack names the leg it leaves."""

    name: str = MAIN
    tie_on: TieOn = dataclasses.field(default_factory=TieOn)
    parent: str = ""
