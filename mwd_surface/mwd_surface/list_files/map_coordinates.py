# SPDX-License-Identifier: Apache-2.0
"""
Conversion of the north and east columns of a list to offsets from the wellhead, if they are map coordinates.

No point of a hole is farther from the wellhead than its measured depth. Positions farther away are map coordinates or
offsets from another point. A known wellhead is subtracted; if it is unknown, the error asks for the wellhead.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.remark import Remark, RemarkKind

# Tolerance, m, of the rule that no point of the hole is farther from the wellhead than the measured depth.
_ROUNDING = 5.0
# Slots of a platform or pad lie within this distance of the origin of their offsets, m.
_SITE = 2000.0
# Positions farther than this from the origin can only be map coordinates, m.
_MAP = 20_000.0
# Below this inclination the first station is taken to lie directly below the wellhead, rad.
_VERTICAL = math.radians(1.0)


def offsets_from_wellhead(
    name: str,
    md: Array,
    pair: Array,
    inclination: float,
    given: Given,
    wellhead: tuple[float, float] | None,
    *,
    charted: bool,
) -> tuple[Array, tuple[Remark, ...]]:
    """
    Return north and east from the wellhead, shape (n, 2), m, and remarks on the assumptions.

    Offsets that are near enough to be from the wellhead, or from another point of the site, are returned unchanged.

    Parameters
    ----------
    name : str
        Name of the list, for messages.
    md, pair : ndarray, shape (n,) and (n, 2)
        Measured depth, and north and east as written in the file, m.
    inclination : float
        Inclination of the first station, rad.
    given : Given
        Wellhead that the caller gives, and values that the caller confirms.
    wellhead : tuple of float, optional
        Northing and easting of the wellhead in the head of the list, m.
    charted : bool
        Whether the columns have names of map axes (northing, easting, x, y).

    Raises
    ------
    ListFileError
        The wellhead is not known, or does not fit the list.
    """
    known = np.all(np.isfinite(pair), axis=1)
    if not np.any(known):
        return pair, ()
    first = int(np.argmax(known))
    place = pair[first]
    beyond = float(np.hypot(*place) - md[first])
    own = given.wellhead or wellhead
    if own is not None and (charted or beyond > _ROUNDING or given.wellhead is not None):
        return _shifted(name, pair, own, float(md[first]), first, given)
    if beyond <= _ROUNDING:
        return pair, ()
    if beyond <= _SITE and not charted:
        text = (
            f"{name}: its first station lies {place[0]:+.2f} m north and {place[1]:+.2f} m east: north and east are"
            " assumed to be measured from another point of the site, and the path starts at this station"
        )
        return pair, (Remark(RemarkKind.TIE_ON_OF_LIST, text, {"north": float(place[0]), "east": float(place[1])}),)
    if not charted and beyond <= _MAP and "wellhead" not in given.confirm:
        raise ListFileError(
            f"{name}: north and east of its first station are {place[0]:.2f} and {place[1]:.2f} m: map coordinates,"
            " or offsets from another point than the wellhead? Give the wellhead with --wellhead NORTHING,EASTING, or"
            " say with --confirm wellhead that the first station is the wellhead"
        )
    if md[first] > 0.0 and inclination > _VERTICAL:
        raise ListFileError(
            f"{name}: north and east are map coordinates ({place[0]:.2f} and {place[1]:.2f} m at {md[first]:.2f} m),"
            " and the list does not say where the wellhead is; give it with --wellhead NORTHING,EASTING"
        )
    return _shifted(name, pair, (float(place[0]), float(place[1])), float(md[first]), first, given)


def _shifted(
    name: str, pair: Array, wellhead: tuple[float, float], depth: float, first: int, given: Given
) -> tuple[Array, tuple[Remark, ...]]:
    """
    Return north and east without the wellhead, shape (n, 2), m, and the remarks on the shift.

    first: index of the first station with a position; depth: its measured depth, m. Raises ListFileError if the hole
    cannot reach this station from the wellhead, unless the caller confirms the wellhead.
    """
    shifted = pair - np.array(wellhead)
    apart = float(np.hypot(*shifted[first]))
    remarks: tuple[Remark, ...] = ()
    if apart > depth + _SITE:
        far = (
            f"{name}: its first station lies {apart / 1000.0:.1f} km from the wellhead at {wellhead[0]:.2f} m N,"
            f" {wellhead[1]:.2f} m E"
        )
        for factor in (0.3048, 1.0 / 0.3048):
            if np.hypot(*(pair[first] * factor - np.array(wellhead))) <= depth + _SITE:
                raise ListFileError(
                    f"{far}, which fits coordinates in ft that were read as m, or in m that were read as ft: write the"
                    " unit into the name of each column, such as MD (ft) and X (m)"
                )
        if "wellhead" not in given.confirm:
            raise ListFileError(
                f"{far}; check both, also that north and east are not exchanged, or confirm it with --confirm wellhead"
            )
        remarks = (Remark(RemarkKind.CONFIRMED, f"{far}; confirmed", {"wellhead": apart}),)
    text = (
        f"{name}: north and east are map coordinates; the wellhead at {wellhead[0]:.2f} m N, {wellhead[1]:.2f} m E is"
        " subtracted"
    )
    values = {"northing": float(wellhead[0]), "easting": float(wellhead[1])}
    return shifted, (*remarks, Remark(RemarkKind.MAP_SHIFTED, text, values))


def wellhead_of(remarks: Iterable[Remark]) -> tuple[float, float] | None:
    """Return northing and easting, m, of the wellhead that was subtracted from a list; None if none was subtracted."""
    shifted = [one.values for one in remarks if one.kind == RemarkKind.MAP_SHIFTED]
    return (shifted[-1]["northing"], shifted[-1]["easting"]) if shifted else None
