# SPDX-License-Identifier: Apache-2.0
"""
The planned well path: where the well is from it, and how to steer back to it or on to a target.

All lengths m, angles rad, positions north, east, down from the wellhead, in the north reference of the plan. Offsets
are seen looking down-hole along the plan: up is towards its high side, right is clockwise from that.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core import settings
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import mat_nt, wrap_tau
from mwd_surface.list_files.remark import Remark
from mwd_surface.trajectory.well_path import Definitive

DRAWN_STEP = 10.0  # m between the points of the plan that the page draws


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """
    Stations of a plan and their positions.

    md, inclination, azimuth: shape (n,), n >= 2, m and rad. positions: shape (n, 3), m. north: "magnetic", "true",
    "grid" or "" where the file did not say. name: for people. remarks: assumptions of its reader.
    """

    md: Array
    inclination: Array
    azimuth: Array
    positions: Array
    north: str = ""
    name: str = ""
    remarks: tuple[Remark, ...] = ()

    def __eq__(self, other: object) -> bool:
        """Whether two plans have the same stations, start, north and name."""
        return isinstance(other, Plan) and self.to_mapping() == other.to_mapping()

    def __hash__(self) -> int:
        """Return a hash that equal plans share."""
        return hash((self.name, self.north, self.md.tobytes()))

    def to_mapping(self) -> dict[str, Any]:
        """Return the plan as a plain table for a file; its path follows from stations and start."""
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
        Return the plan of such a table.

        Raises
        ------
        ValueError
            The table has not the fields of a plan, or no path goes through its stations.
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
        """The end of the plan, shape (3,), m."""
        return np.asarray(self.positions[-1])

    @property
    def section_azimuth(self) -> float:
        """Azimuth from the first station to the last, rad: the usual one for the vertical section."""
        return mc.closure(self.positions)


@dataclasses.dataclass(frozen=True)
class Offset:
    """
    Where a point is from the plan.

    distance: to the nearest point of the plan, m. plan_md: there. up, right: of the point from the plan, in the plane
    across it, m. horizontal: distance in the map, m. vertical: below the plan (+), m. toolface: direction from the
    well to the plan across the hole, from its high side, rad; the toolface that steers back.
    """

    distance: float
    plan_md: float
    up: float
    right: float
    horizontal: float
    vertical: float
    toolface: float


@dataclasses.dataclass(frozen=True)
class Steering:
    """One arc to a target: its length, m, dogleg severity, rad/m, toolface and the direction at its end, rad."""

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
    A plan from its stations.

    start, shape (3,): position of the first one, m; left out, it lies straight below the wellhead at its measured
    depth.

    Raises
    ------
    ValueError
        As `minimum_curvature.path`, or fewer than two stations.
    """
    depth, inc, azi = mc.checked_stations(md, inclination, azimuth)
    if depth.size < 2:
        raise ValueError("md: a plan needs at least two stations, got 1")
    first = (0.0, 0.0, depth[0]) if start is None else start
    return Plan(depth, inc, azi, mc.path(depth, inc, azi, first), north, name)


def interpolated(plan: Plan, step: float) -> Plan:
    """
    The same path with a station at least every `step` metres, for drawing.

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
    Distance and direction between the well and the plan.

    Parameters
    ----------
    plan : Plan
    position : array_like, shape (3,)
        Of the well (a survey, or the bit), m.
    inclination, azimuth : float
        Of the well there, rad; only the toolface depends on them.
    """
    point = np.asarray(position, dtype=float)
    md = nearest(plan, point)
    inc, azi, foot = mc.interpolate(plan.md, plan.inclination, plan.azimuth, plan.positions, md)
    away = point - foot
    mat_plan = mat_nt(inc, azi, 0.0)
    # At toolface 0 the scribe line is the high side; the right side is minus the second axis.
    up, right = float(away @ mat_plan[:, 2]), float(-away @ mat_plan[:, 1])
    return Offset(
        distance=float(np.linalg.norm(away)),
        plan_md=md,
        up=up,
        right=right,
        horizontal=math.hypot(away[0], away[1]),
        vertical=float(away[2]),
        toolface=_toolface_of(-away, inclination, azimuth),
    )


def offset_of_end(plan: Plan | None, path: Definitive) -> tuple[Offset | None, float | None]:
    """Offset of the end of a path from the plan, and the dogleg severity from there to the target, rad/m, if known."""
    if plan is None or len(path.md) < 2:
        return None, None
    end = path.positions[-1], float(path.inclination[-1]), float(path.azimuth[-1])
    try:
        dogleg: float | None = steering_to(*end, plan.target).dogleg_severity
    except ValueError:
        # The target is reached or behind the bit: no arc leads there.
        dogleg = None
    return offset_from(plan, *end), dogleg


def nearest(plan: Plan, point: ArrayLike) -> float:
    """Measured depth of the point of the plan that is nearest to a point, shape (3,), m; exact on every arc."""
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
    # In the plane of the arc the nearest point is on the ray from its centre.
    on_arc = np.arctan2(along, radius - across) * radius
    at = plan.md[:-1] + np.clip(np.where(bent, on_arc, along), 0.0, length)
    candidates = np.concatenate([plan.md, np.minimum(at, plan.md[1:])])
    _, _, places = mc.interpolate(plan.md, plan.inclination, plan.azimuth, plan.positions, candidates)
    return float(candidates[np.argmin(np.linalg.norm(places - p, axis=1))])


def steering_to(position: ArrayLike, inclination: float, azimuth: float, target: ArrayLike) -> Steering:
    """
    The single arc from a place and direction to a target point.

    The chord makes half the dogleg with the tangent, so length and curvature follow from its direction alone.

    Parameters
    ----------
    position, target : array_like, shape (3,)
        m.
    inclination, azimuth : float
        At the position, rad.

    Raises
    ------
    ValueError
        The target is the position itself, or lies straight behind, where no arc reaches it.
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
    return Steering(
        length=length,
        dogleg_severity=2.0 * half / length,
        toolface=_toolface_of(chord, inclination, azimuth),
        inclination=math.atan2(math.hypot(end[0], end[1]), end[2]),
        azimuth=float(wrap_tau(math.atan2(end[1], end[0]))),
    )


def _toolface_of(direction_n: Array, inclination: float, azimuth: float) -> float:
    """Toolface whose steering plane contains a direction; rad from the high side, or from north where vertical."""
    mat = mat_nt(inclination, azimuth_at(inclination, azimuth), 0.0)
    return float(wrap_tau(math.atan2(-float(direction_n @ mat[:, 1]), float(direction_n @ mat[:, 2]))))


def azimuth_at(inclination: float, azimuth: float) -> float:
    """Return the azimuth of the high side, rad; 0 in a vertical hole, so that a toolface there counts from north."""
    return 0.0 if math.sin(inclination) < mc.VERTICAL else azimuth
