# SPDX-License-Identifier: Apache-2.0
"""
What the columns of a list of stations are, and their units: by the names people give them, or as the caller says.

A unit stands at the end of a name (md_m, "MD [ft]"), in a line of its own below the names, or comes from the caller.
A length whose unit nobody named is never guessed; angles without unit are degrees.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence

NEEDED = ("md", "inclination", "azimuth")
# What a list of our own says of the reference: T and m/s^2, or angles.
FIGURES = {"b_reference": 1e-9, "g_reference": 1.0, "dip_reference": None, "declination": None, "convergence": None}
ANGLES = ("inclination", "azimuth", "sigma_inclination", "sigma_azimuth", *(n for n, f in FIGURES.items() if not f))
TEXTS = ("azimuth_reference", "tool", "time", "verdict", "station")
NORTHS = ("true", "grid", "magnetic")

# The US survey foot is 1200/3937 m.
LENGTH_UNITS = {
    **dict.fromkeys(("m", "meter", "metre", "meters", "metres"), 1.0),
    **dict.fromkeys(("ft", "feet", "foot", "fti"), 0.3048),
    "ftus": 1200.0 / 3937.0,
}
ANGLE_UNITS = {
    **dict.fromkeys(("deg", "dega", "degree", "degrees"), math.pi / 180.0),
    **dict.fromkeys(("rad", "radian", "radians"), 1.0),
    **dict.fromkeys(("grad", "gon", "grads", "gradians"), math.pi / 200.0),
}
_WORDS = {
    "md": "md measured_depth depth dept md_rkb along_hole_depth ahd",
    "inclination": "inc incl inclination devi deviation drift",
    "azimuth": "azi azim azimuth az azm hazi direction",
    "tvd": "tvd vertical_depth true_vertical_depth",
    "north": "north ns n_s disp_ns n local_north northing",
    "east": "east ew e_w disp_ew e local_east easting",
    "sigma_inclination": "sigma_inclination",
    "sigma_azimuth": "sigma_azimuth",
    "b_reference": "b_reference_nt",
    "g_reference": "g_reference_mps",
    "dip_reference": "dip_reference",
    "declination": "declination",
    "convergence": "convergence",
    "azimuth_reference": "azimuth_reference azi_ref north_reference",
    "tool": "tool_code survey_tool tool station_type",
    "time": "time time_utc dtim dtim_utc dtim_stn date_time",
    "verdict": "verdict automatic",
    "station": "station",
}
_NAMES = {name: what for what, names in _WORDS.items() for name in names.split()}


class ListFileError(ValueError):
    """A file that is no list of stations; the message gives file, line and rule."""


@dataclasses.dataclass(frozen=True)
class Given:
    """
    What the caller says of a list.

    Attributes
    ----------
    columns : mapping of str
        Quantity (md, inclination, azimuth, tvd, north, east ...) -> name of its column. An empty name: do not read it.
    length_unit, angle_unit, north : str
        Replace what the file says; empty: as the file says.
    """

    columns: Mapping[str, str] = dataclasses.field(default_factory=dict)
    length_unit: str = ""
    angle_unit: str = ""
    north: str = ""

    def __post_init__(self) -> None:
        """Refuse a quantity, unit or north that there is not."""
        for value, known, what in (
            *((name, tuple(_WORDS), "columns") for name in self.columns),
            (self.length_unit, tuple(LENGTH_UNITS), "length unit"),
            (self.angle_unit, tuple(ANGLE_UNITS), "angle unit"),
            (self.north, NORTHS, "north"),
        ):
            if value and value not in known:
                raise ValueError(f"{what}: {value!r} is none of {', '.join(known)}")


@dataclasses.dataclass(frozen=True)
class Columns:
    """Column number, unit as written ("" where none) of each quantity, and the north that the azimuth's name says."""

    number: Mapping[str, int]
    units: Mapping[str, str]
    north: str

    @property
    def missing(self) -> list[str]:
        """Those needed that are not there."""
        return [what for what in NEEDED if what not in self.number]


def find(names: Sequence[str], given: Given | None = None, units: Sequence[str] = ()) -> Columns:
    """
    Match columns to quantities.

    names: of the columns. given: what the caller says of them. units: of the columns where they stand apart, as in LAS.
    """
    given = given or Given()
    number: dict[str, int] = {}
    found: dict[str, str] = {}
    north = ""
    for k, name in enumerate(names):
        what, unit, says = _meaning(name)
        chosen = [q for q, column in given.columns.items() if column and column.strip() == name.strip()]
        if not chosen and (what in given.columns or what in number):
            continue
        what = chosen[0] if chosen else what
        if not what:
            continue
        number[what] = k
        found[what] = units[k].lower() if units and units[k] else unit
        if what == "azimuth":
            north = says
    return Columns(number, found, north)


def factor(what: str, unit: str, at: str, given: Given | None = None) -> float:
    """
    What to multiply a quantity by to get m or rad.

    Raises
    ------
    ListFileError
        A length without unit, or an unknown unit; `at` is the place in the file.
    """
    own = FIGURES.get(what)
    if own is not None:
        return own
    angle = what in ANGLES
    known = ANGLE_UNITS if angle else LENGTH_UNITS
    said = "" if given is None else given.angle_unit if angle else given.length_unit
    unit = said or unit or ("deg" if angle else "")
    if not unit:
        raise ListFileError(f"{at}: {what} has no unit; write {what}_m or {what}_ft, or name it with --length-unit")
    if unit not in known:
        raise ListFileError(f"{at}: {what} in {unit!r}; expected one of {', '.join(known)}")
    return known[unit]


def _meaning(name: str) -> tuple[str, str, str]:
    """Quantity, unit and north that a name of a column says; empty texts where it says none."""
    words = [w for w in re.split(r"[^a-z]+", name.lower().replace("°", " deg ")) if w]
    unit = words.pop() if len(words) > 1 and words[-1] in {**LENGTH_UNITS, **ANGLE_UNITS} else ""
    # north_m and azimuth_reference are quantities of their own.
    joined = "_".join(words)
    if joined in _NAMES:
        return _NAMES[joined], unit, ""
    norths = [w for w in words if w in NORTHS or w == "mag"]
    what = _NAMES.get("_".join(w for w in words if w not in norths), "")
    return what, unit, ("magnetic" if norths[0] == "mag" else norths[0]) if norths else ""
