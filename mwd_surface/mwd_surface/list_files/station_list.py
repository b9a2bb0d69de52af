# SPDX-License-Identifier: Apache-2.0
"""A list of stations as it was read, and the point from which its path starts: one rule for lists, plans and wells."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_surface.list_files.remark import Remark, RemarkKind

# Where a start comes from, in the words of `surveys.leg.Origin`.
WELLHEAD, FIRST_STATION, WITHOUT_POSITION = "wellhead", "first station of the list", "given without a position"
POSITION = ("north", "east", "tvd")
# A first station whose own position an arc from the wellhead reaches this closely has left the wellhead vertically:
# rounding, and what methods of calculation differ by over so short a way; m, and share of the depth.
_REACHED, _REACHED_SHARE = 0.2, 0.001
# Up to this inclination a station without azimuth is vertical: over 30 m it then lies within half a metre, rad.
VERTICAL = math.radians(1.0)
# Dogleg of a hole above that is assumed to leave the wellhead vertically, rad/m; twice that of most motors.
_SHARPEST = math.radians(20.0) / 30.0


@dataclasses.dataclass(frozen=True)
class Start:
    """
    The point from which the path of a list starts.

    md, inclination, azimuth: m and rad. position: north, east, down, m. source: one of the words of `leg.Origin`.
    remarks: what is assumed.
    """

    md: float
    inclination: float
    azimuth: float
    position: tuple[float, float, float]
    source: str
    remarks: tuple[Remark, ...] = ()


@dataclasses.dataclass(frozen=True)
class StationList:
    """
    Stations as a file has them.

    Attributes
    ----------
    name, north : str
        For people; and what azimuths are from: "magnetic", "true", "grid", or "" where the file does not say.
    md, inclination, azimuth : ndarray, shape (n,)
        m, increasing; rad. An azimuth that is not given is nan.
    positions : ndarray, shape (n, 3)
        North, east, down from the wellhead as the file has them, m; nan where it has none. They are checked against
        the angles.
    sigma_inclination, sigma_azimuth : ndarray, shape (n,)
        rad; nan where not given.
    tool, time, verdict : tuple of str
        Of each station as written; empty where not given.
    figures : mapping of ndarray, shape (n,)
        Reference of each station by the names of `list_columns.FIGURES`: T, m/s^2, rad; nan where not given.
    remarks : tuple of Remark
        Every assumption that the reader made, and everything that it left out.
    start : Start, optional
        Where the path starts, where the file says so itself, as our exports do.
    well : dict
        Settings of the well, where the file has them, as our exports do.
    """

    name: str
    north: str
    md: Array
    inclination: Array
    azimuth: Array
    positions: Array
    sigma_inclination: Array
    sigma_azimuth: Array
    tool: tuple[str, ...]
    time: tuple[str, ...]
    verdict: tuple[str, ...]
    figures: Mapping[str, Array]
    remarks: tuple[Remark, ...] = ()
    start: Start | None = None
    well: dict[str, Any] = dataclasses.field(default_factory=dict)


def carried(azimuth: Array) -> Array:
    """Return azimuths in which a station without one has that of the station above, else of the first with one."""
    known = np.flatnonzero(~np.isnan(azimuth))
    if not known.size:
        return np.zeros_like(azimuth)
    above = np.searchsorted(known, np.arange(azimuth.size), side="right") - 1
    return np.asarray(azimuth[known[np.maximum(above, 0)]])


def start_of(stations: StationList) -> Start:
    """
    Return where the path of a list starts.

    The point that the file itself names, as our exports do. Otherwise the first station, where it lies at depth 0. A
    list that begins below has the hole above it added: it leaves the wellhead vertically, or straight towards a first
    station that is too near for that. Only where the list gives a position of its first station that such a hole does
    not reach does the path start there, and nothing is known of the hole above.
    """
    if stations.start is not None:
        return stations.start
    md, inclination = float(stations.md[0]), float(stations.inclination[0])
    azimuth = 0.0 if math.isnan(stations.azimuth[0]) else float(stations.azimuth[0])
    north, east, down = (float(v) for v in stations.positions[0])
    own = (0.0 if math.isnan(north) else north, 0.0 if math.isnan(east) else east, md if math.isnan(down) else down)
    if md <= 0.0:
        return Start(md, inclination, azimuth, own, FIRST_STATION)
    given = not math.isnan(down)
    # A hole that would have to turn too sharply left its collar in the direction of the first station.
    vertical = inclination <= _SHARPEST * md
    top = 0.0 if vertical else inclination
    reached = mc.path([0.0, md], [top, inclination], [azimuth, azimuth])[-1]
    # What the list does not give cannot contradict the hole.
    miss = float(np.linalg.norm(np.nan_to_num(reached - stations.positions[0]))) if given else 0.0
    if miss <= _REACHED + _REACHED_SHARE * md:
        how = "vertically and to reach" if vertical else "straight towards"
        text = (
            f"{stations.name} begins at {md:.2f} m: the hole above is assumed to leave the wellhead {how} the first"
            " station"
        )
        assumed = Remark(RemarkKind.HOLE_ABOVE_ASSUMED, text, {"measured_depth": md, "inclination": inclination})
        return Start(0.0, top, 0.0 if vertical else azimuth, (0.0, 0.0, 0.0), WELLHEAD, (assumed,))
    kind = RemarkKind.TIE_ON_OF_LIST
    place = f"{north:+.2f} m north, {east:+.2f} m east"
    if math.isnan(north) or math.isnan(east):
        kind = RemarkKind.TIE_ON_ASSUMED
        place = "north and east not both given, what is missing taken as that of the wellhead"
    text = (
        f"{stations.name} begins at {md:.2f} m with a position of its own, {own[2]:.2f} m TVD, {place}: the path starts"
        " there, and the hole above is not known"
    )
    remark = Remark(kind, text, {"measured_depth": md})
    source = FIRST_STATION if kind == RemarkKind.TIE_ON_OF_LIST else WITHOUT_POSITION
    return Start(md, inclination, azimuth, own, source, (remark,))


def completed(stations: StationList) -> tuple[Array, Array, Array, tuple[float, float, float], tuple[Remark, ...]]:
    """
    Return measured depth, inclination and azimuth with the hole above added, the start position, and all remarks.

    An azimuth that is not given stays nan.
    """
    start = start_of(stations)
    columns = stations.md, stations.inclination, stations.azimuth
    if start.md < stations.md[0]:
        md, inc, azi = (
            np.concatenate([[a], b]) for a, b in zip((start.md, start.inclination, start.azimuth), columns, strict=True)
        )
        columns = md, inc, azi
    return *columns, start.position, (*stations.remarks, *start.remarks)
