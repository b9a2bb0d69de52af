# SPDX-License-Identifier: Apache-2.0
"""
Planned well path and its file, the offset of the well from the plan, and the arc that steers back to it or to a target.

Lengths are in m, angles in rad, positions north, east, down from the wellhead, in the north reference of the plan.
Offsets are seen looking downhole along the plan: up is towards the high side of the plan, right is clockwise from up.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core import settings
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import mat_nt, wrap_tau
from mwd_surface.list_files.list_columns import Given
from mwd_surface.list_files.list_error import ListFileError
from mwd_surface.list_files.list_file import read_list
from mwd_surface.list_files.remark import Remark, RemarkKind
from mwd_surface.list_files.station_list import VERTICAL, StationList, carried, completed
from mwd_surface.trajectory.well_path import Definitive

DRAWN_STEP = 10.0  # distance between the drawn points of the plan, m


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """Planned well path: its stations and their positions."""

    #: `md`, `inclination`, `azimuth`: shape (n,), n >= 2, m and rad
    md: Array
    inclination: Array
    azimuth: Array
    positions: Array  #: shape (n, 3), m
    north: str = ""  #: "magnetic", "true" or "grid", or "" if the file does not name the north
    name: str = ""  #: name shown to users
    remarks: tuple[Remark, ...] = ()  #: assumptions made on reading

    def __eq__(self, other: object) -> bool:
        """Whether two plans have the same stations, start, north, name and remarks."""
        return isinstance(other, Plan) and self.to_mapping() == other.to_mapping()

    def __hash__(self) -> int:
        """Return a hash; equal plans have equal hashes."""
        return hash((self.name, self.north, self.md.tobytes()))

    def to_mapping(self) -> dict[str, Any]:
        """Return the plan as a dict for a file: stations and start, without the positions, which follow from these."""
        stations = np.column_stack([self.md, self.inclination, self.azimuth])
        start = self.positions[0].tolist()
        remarks = [settings.to_mapping(one) for one in self.remarks]
        return {
            "name": self.name,
            "north": self.north,
            "start": start,
            "stations": stations.tolist(),
            "remarks": remarks,
        }

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any]) -> Plan:
        """
        Return the plan from a dict made by `to_mapping`.

        Raises
        ------
        ValueError
            The table does not have the fields of a plan, or its path cannot be computed.
        """
        try:
            md, inclination, azimuth = np.asarray(table["stations"], dtype=float).reshape(-1, 3).T
            start, words = np.asarray(table["start"], dtype=float), (str(table["north"]), str(table["name"]))
            remarks = tuple(settings.from_mapping(Remark, one, "plan.remarks") for one in table["remarks"])
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"plan: expected name, north, start, stations and remarks, got {table!r:.80}") from error
        return dataclasses.replace(plan_of(md, inclination, azimuth, start, *words), remarks=remarks)

    @property
    def target(self) -> Array:
        """End of the plan, shape (3,), m."""
        return np.asarray(self.positions[-1])

    @property
    def section_azimuth(self) -> float:
        """Azimuth from the first station to the last, rad; the usual azimuth of the vertical section."""
        return mc.closure(self.positions)


@dataclasses.dataclass(frozen=True)
class Offset:
    """Offset of a point from the plan."""

    distance: float  #: distance to the nearest point of the plan, m
    plan_md: float  #: measured depth of this plan point, m
    #: `up`, `right`: components from the plan to the point, in the plane perpendicular to the plan, m
    up: float
    right: float
    horizontal: float  #: distance on the map, m
    vertical: float  #: depth below the plan, m
    #: direction from the well to the plan, perpendicular to the hole, rad from the high side; steering to this toolface
    #: leads back to the plan
    toolface: float
    #: dogleg severity of the arc from the bit to the target of the plan, rad/m; NaN if no arc reaches the target
    dogleg_to_target: float = math.nan


@dataclasses.dataclass(frozen=True)
class ArcToTarget:
    """Arc to a target: length, m, dogleg severity, rad/m, toolface, and the direction at its end, rad."""

    length: float
    dogleg_severity: float
    toolface: float
    inclination: float
    azimuth: float


def plan_of(
    md: ArrayLike,
    inclination: ArrayLike,
    azimuth: ArrayLike,
    start: ArrayLike | None = None,
    north: str = "",
    name: str = "",
) -> Plan:
    """
    Return the plan through stations: measured depth, m, inclination and azimuth, rad, shape (n,) each.

    start, shape (3,): position of the first station, m; by default vertically below the wellhead, with the measured
    depth of the station as vertical depth.

    Raises
    ------
    ValueError
        The stations are invalid as in `minimum_curvature.path`, or there are fewer than two.
    """
    depth, inc, azi = mc.checked_stations(md, inclination, azimuth)
    if depth.size < 2:
        raise ValueError("md: a plan needs at least two stations, got 1")
    first = (0.0, 0.0, depth[0]) if start is None else start
    return Plan(depth, inc, azi, mc.path(depth, inc, azi, first), north, name)


def interpolated(plan: Plan, step: float) -> Plan:
    """
    Return the same path with additional stations, at most `step` metres apart, for drawing.

    Raises
    ------
    ValueError
        step is not positive.
    """
    if not step > 0.0:
        raise ValueError(f"step: must be positive, got {step}")
    between = np.arange(plan.md[0], plan.md[-1], step)
    md = np.unique(np.concatenate([plan.md, between]))
    inc, azi, positions = mc.interpolate(plan.md, plan.inclination, plan.azimuth, plan.positions, md)
    return dataclasses.replace(plan, md=md, inclination=inc, azimuth=azi, positions=positions)


def offset_from(plan: Plan, position: ArrayLike, inclination: float, azimuth: float) -> Offset:
    """
    Return distance and direction between the well and the plan.

    Parameters
    ----------
    position : array_like, shape (3,)
        Position of the well (a survey, or the bit), m.
    inclination, azimuth : float
        Direction of the well at this position, rad; affects only the toolface of the result.
    """
    point = np.asarray(position, dtype=float)
    md = nearest(plan, point)
    _, _, foot = mc.interpolate(plan.md, plan.inclination, plan.azimuth, plan.positions, md)
    away = point - foot
    right, up = (float(axis @ away) for axis in across(plan, md))
    return Offset(
        distance=float(np.linalg.norm(away)),
        plan_md=md,
        up=up,
        right=right,
        horizontal=math.hypot(away[0], away[1]),
        vertical=float(away[2]),
        toolface=_toolface_of(-away, inclination, azimuth),
    )


def across(plan: Plan, md: float) -> Array:
    """Return the unit vectors right and up, perpendicular to the plan, at a measured depth, m; shape (2, 3)."""
    inc, azi, _ = mc.interpolate(plan.md, plan.inclination, plan.azimuth, plan.positions, md)
    mat_plan = mat_nt(inc, azi, 0.0)
    # At toolface 0 the third tool axis points to the high side, and the second axis to the left.
    return np.stack([-mat_plan[:, 1], mat_plan[:, 2]])


def straight(inclination: float, azimuth: float, length: float, north: str = "", name: str = "") -> Plan:
    """
    Return the plan of a straight hole of a length, m, that begins at position 0; direction in rad.

    Raises
    ------
    ValueError
        The length is not positive.
    """
    if not length > 0.0:
        raise ValueError(f"length: must be positive, got {length}")
    return plan_of([0.0, length], [inclination] * 2, [azimuth] * 2, (0.0, 0.0, 0.0), north, name)


def offset_of_end(plan: Plan | None, path: Definitive) -> Offset | None:
    """Return the offset of a path's end from the plan; None without a plan or a survey."""
    if plan is None or len(path.md) < 2:
        return None
    end = path.positions[-1], float(path.inclination[-1]), float(path.azimuth[-1])
    try:
        dogleg = steering_to(*end, plan.target).dogleg_severity
    except ValueError:
        # The target is reached or lies behind the bit, so no arc leads to the target.
        dogleg = math.nan
    return dataclasses.replace(offset_from(plan, *end), dogleg_to_target=dogleg)


def nearest(plan: Plan, point: ArrayLike) -> float:
    """Return the measured depth, m, of the point on the plan's arcs that is nearest to a position, shape (3,), m."""
    p = np.asarray(point, dtype=float)
    t_1, t_2 = mc.tangent(plan.inclination[:-1], plan.azimuth[:-1]), mc.tangent(plan.inclination[1:], plan.azimuth[1:])
    length = np.diff(plan.md)
    angle = mc.dogleg(plan.inclination[:-1], plan.azimuth[:-1], plan.inclination[1:], plan.azimuth[1:])
    away = p - plan.positions[:-1]
    along = np.sum(away * t_1, axis=1)
    bent = angle > 1e-9
    s_angle = np.where(bent, np.sin(angle), 1.0)
    inward = (t_2 - np.cos(angle)[:, None] * t_1) / s_angle[:, None]
    radius = length / np.where(bent, angle, 1.0)
    across = np.sum(away * inward, axis=1)
    # In the plane of the arc, the nearest point lies on the ray from the centre through the projected point.
    on_arc = np.arctan2(along, radius - across) * radius
    at = plan.md[:-1] + np.clip(np.where(bent, on_arc, along), 0.0, length)
    candidates = np.concatenate([plan.md, np.minimum(at, plan.md[1:])])
    _, _, places = mc.interpolate(plan.md, plan.inclination, plan.azimuth, plan.positions, candidates)
    return float(candidates[np.argmin(np.linalg.norm(places - p, axis=1))])


def steering_to(position: ArrayLike, inclination: float, azimuth: float, target: ArrayLike) -> ArcToTarget:
    """
    Return the single arc from a position and direction to a target point.

    The angle between chord and tangent is half the dogleg, so chord and tangent determine length and curvature.

    Parameters
    ----------
    position, target : array_like, shape (3,)
        Start and end of the arc, m.
    inclination, azimuth : float
        Direction at the position, rad.

    Raises
    ------
    ValueError
        The target is the position itself or not finite, or lies 90 deg or more off the direction at the position, so
        that no arc of half a turn or less leads to the target.
    """
    chord = np.asarray(target, dtype=float) - np.asarray(position, dtype=float)
    reach = float(np.linalg.norm(chord))
    if not math.isfinite(reach) or reach < 1e-9:
        raise ValueError(f"target: must be finite and apart from the position, got {reach} m")
    t = mc.tangent(inclination, azimuth)
    direction = chord / reach
    half = 2.0 * math.atan2(float(np.linalg.norm(direction - t)), float(np.linalg.norm(direction + t)))
    if half > math.pi / 2 - mc.REVERSAL:
        raise ValueError("target: it lies behind the bit; no single arc of half a turn or less reaches it")
    length = reach / float(np.sinc(half / math.pi))
    end = 2.0 * math.cos(half) * direction - t
    return ArcToTarget(
        length=length,
        dogleg_severity=2.0 * half / length,
        toolface=_toolface_of(chord, inclination, azimuth),
        inclination=math.atan2(math.hypot(end[0], end[1]), end[2]),
        azimuth=float(wrap_tau(math.atan2(end[1], end[0]))),
    )


def _toolface_of(direction_n: Array, inclination: float, azimuth: float) -> float:
    """Return the toolface that steers to a direction, rad from the high side, or from north in a vertical hole."""
    mat = mat_nt(inclination, azimuth_at(inclination, azimuth), 0.0)
    return float(wrap_tau(math.atan2(-float(direction_n @ mat[:, 1]), float(direction_n @ mat[:, 2]))))


def azimuth_at(inclination: float, azimuth: float) -> float:
    """Return the azimuth of the high side, rad; 0 in a vertical hole, where the toolface is measured from north."""
    return 0.0 if math.sin(inclination) < mc.VERTICAL else azimuth


def read_plan(path: str | Path, north: str = "", given: Given | None = None) -> Plan:
    """
    Return the plan in a file, in any format that `list_file.read_list` reads.

    north: north from which the azimuths must be measured, "magnetic", "true" or "grid"; empty: any. given: facts about
    the file that the caller states.

    Raises
    ------
    ListFileError
        The file is missing, unreadable, too large or not a plan, or its azimuths are from another north; the message
        names file, line and rule.
    """
    return in_north(plan_from_list(read_list(path, given)), path, north)


def in_north(plan: Plan, path: str | Path, north: str) -> Plan:
    """
    Return the plan if its azimuths are from the north of a well; north: name of this north, empty: any.

    If the plan does not name its north, its azimuths are assumed to be from the north of the well, and a remark is
    added.

    Raises
    ------
    ListFileError
        The plan's azimuths are from another north; the message names both.
    """
    if north and plan.north not in ("", north):
        raise ListFileError(f"{path}: its azimuths are from {plan.north} north, those of the well from {north} north")
    if north and not plan.north:
        text = f"{plan.name} does not name the north of its azimuths: {north} north is assumed, as in the well"
        plan = dataclasses.replace(plan, remarks=(*plan.remarks, Remark(RemarkKind.NORTH_ASSUMED, text)))
    return plan


def plan_from_list(stations: StationList) -> Plan:
    """
    Return the plan through a list of stations; it starts at `station_list.start_of`, like the path of every list.

    Raises
    ------
    ListFileError
        There are fewer than two stations, or a station that is not vertical has no azimuth.
    """
    if stations.md.size < 2:
        raise ListFileError(f"{stations.name}: a plan needs at least two stations, got {stations.md.size}")
    without = np.isnan(stations.azimuth)
    deviated = without & (stations.inclination > VERTICAL)
    if deviated.any():
        raise ListFileError(
            f"{stations.name}: no azimuth at {stations.md[deviated][0]:g} m, where the hole is not vertical; a plan or"
            " an offset well needs each azimuth"
        )
    if without.any():
        # The azimuth of a vertical station is undefined: use the azimuth of an adjacent station.
        stations = dataclasses.replace(stations, azimuth=carried(stations.azimuth))
    md, inclination, azimuth, start, remarks = completed(stations)
    plan = plan_of(md, inclination, azimuth, start, stations.north, stations.name)
    return dataclasses.replace(plan, remarks=remarks)
