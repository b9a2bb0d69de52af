# SPDX-License-Identifier: Apache-2.0
"""A list of stations as read from a file, and the start of its path, for survey lists, plans and offset wells."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_surface.list_files.remark import Remark, RemarkKind

# Sources of a start, in the words of `surveys.leg.Origin`.
WELLHEAD, FIRST_STATION, WITHOUT_POSITION = "wellhead", "first station of the list", "given without a position"
POSITION = ("north", "east", "tvd")
# Largest distance between the listed position of the first station and the position computed for a vertical start at
# the wellhead: this length, m, plus this share of the depth. It covers rounding and different calculation methods.
_REACHED, _REACHED_SHARE = 0.2, 0.001
# A station without azimuth counts as vertical up to this inclination, rad; over 30 m the hole then moves sideways by
# about half a metre.
VERTICAL = math.radians(1.0)
# Largest dogleg of an assumed hole that leaves the wellhead vertically, rad/m; twice that of most motors.
_SHARPEST = math.radians(20.0) / 30.0


@dataclasses.dataclass(frozen=True)
class Start:
    """Point at which the path of a list starts."""

    #: `md`, `inclination`, `azimuth`: m and rad
    md: float
    inclination: float
    azimuth: float
    position: tuple[float, float, float]  #: position of the start: north, east, down, m
    source: str  #: origin of the start, one of the words of `leg.Origin`
    remarks: tuple[Remark, ...] = ()  #: assumptions about the start of the path


@dataclasses.dataclass(frozen=True)
class StationList:
    """Stations as written in a file."""

    name: str  #: name of the list, for people
    #: north from which azimuths are measured: "magnetic", "true", "grid", or "" if the file does not state it
    north: str
    #: `md`, `inclination`, `azimuth`: shape (n,); measured depth, m, increasing; angles in rad. A missing azimuth is
    #: nan.
    md: Array
    inclination: Array
    azimuth: Array
    #: shape (n, 3); north, east, down from the wellhead as written in the file, m; nan if missing. They are checked
    #: against the angles.
    positions: Array
    #: `sigma_inclination`, `sigma_azimuth`: shape (n,); standard deviations, rad; nan if missing
    sigma_inclination: Array
    sigma_azimuth: Array
    #: `tool`, `time`, `verdict`: texts of each station as written; empty if missing
    tool: tuple[str, ...]
    time: tuple[str, ...]
    verdict: tuple[str, ...]
    #: shape (n,); reference values of each station by the names of `list_columns.FIGURES`: T, m/s^2, rad; nan if
    #: missing
    figures: Mapping[str, Array]
    remarks: tuple[Remark, ...] = ()  #: every assumption that the reader made, and everything that the reader left out
    start: Start | None = None  #: start of the path, if the file states it, which exports of this program do
    #: settings of the well, if the file has them, which exports of this program do
    well: dict[str, Any] = dataclasses.field(default_factory=dict)


def carried(azimuth: Array) -> Array:
    """
    Return the azimuths, shape (n,), with each missing one replaced by the last known azimuth above it.

    Above the first known azimuth, that azimuth is used; if no azimuth is known, all are 0.
    """
    known = np.flatnonzero(~np.isnan(azimuth))
    if not known.size:
        return np.zeros_like(azimuth)
    above = np.searchsorted(known, np.arange(azimuth.size), side="right") - 1
    return np.asarray(azimuth[known[np.maximum(above, 0)]])


def start_of(stations: StationList) -> Start:
    """
    Return the point at which the path of a list starts.

    A start that the file itself states, as exports of this program do, is used. Otherwise the first station is the
    start if it lies at depth 0. For a list that begins deeper, the hole above is added: it leaves the wellhead
    vertically, or straight towards a first station that is too close for a vertical start. If the list gives a position
    of its first station that such a hole does not reach, the path starts at that position and the hole above is
    unknown.
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
    # A vertical start would need too sharp a turn here; the hole then leaves the wellhead in the station's direction.
    vertical = inclination <= _SHARPEST * md
    top = 0.0 if vertical else inclination
    reached = mc.path([0.0, md], [top, inclination], [azimuth, azimuth])[-1]
    # A missing coordinate cannot contradict the assumed hole.
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
        place = "but not both north and east are given, so the missing value of the wellhead is used"
    text = (
        f"{stations.name} begins at {md:.2f} m with a position of its own, {own[2]:.2f} m TVD, {place}: the path starts"
        " there, and the hole above is not known"
    )
    remark = Remark(kind, text, {"measured_depth": md})
    source = FIRST_STATION if kind == RemarkKind.TIE_ON_OF_LIST else WITHOUT_POSITION
    return Start(md, inclination, azimuth, own, source, (remark,))


def completed(stations: StationList) -> tuple[Array, Array, Array, tuple[float, float, float], tuple[Remark, ...]]:
    """
    Return measured depth, m, inclination and azimuth, rad, the start position, m, and all remarks of a list.

    If the path starts above the first station, its start is added as the first row. Shapes: (n,) or (n + 1,), and three
    numbers north, east, down.

    A missing azimuth stays nan.
    """
    start = start_of(stations)
    columns = stations.md, stations.inclination, stations.azimuth
    if start.md < stations.md[0]:
        md, inc, azi = (
            np.concatenate([[a], b]) for a, b in zip((start.md, start.inclination, start.azimuth), columns, strict=True)
        )
        columns = md, inc, azi
    return *columns, start.position, (*stations.remarks, *start.remarks)
