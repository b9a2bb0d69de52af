# SPDX-License-Identifier: Apache-2.0
"""
Hole in a mine: its branches, its deviation from the design, and its closure on a surveyed point.

The deviation is left or right and up or down at every station, at the bit and ahead of it. The offsets are at right
angles to the design (`trajectory.plan.offset_from`). Their sigmas come from the position covariance of the error model,
in the same two directions. Ahead of the bit the hole is continued straight; the stations there count as stations of the
tool in the hole, so that their sigmas grow with the error of the direction of the hole.

The closure compares the path with a point of known coordinates, for example the place where the hole breaks through
into a roadway. The closure error is the position of the path minus the position of the point, seen looking along the
hole: right or left, up or down, and along. A chi-square test compares it with the covariances of path and point.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_estimation.core.chi_square import exceeded
from mwd_sensors.core import minimum_curvature as mc
from mwd_sensors.core.arrays import Array
from mwd_sensors.core.frames import mat_nt
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well_position import AHEAD, continued, uncertain
from mwd_surface.trajectory.plan import across, azimuth_at, offset_from, plan_of
from mwd_surface.trajectory.well_path import Definitive

# Branches.


@dataclasses.dataclass(frozen=True)
class Branch:
    """A branch of the hole."""

    #: `name`, `parent`: names of the leg that is the branch, and of the leg that the branch leaves.
    name: str
    parent: str
    current: bool  #: whether the next surveys belong to the branch
    #: `measured_depth`, `inclination`, `azimuth`, `position`: kick-off point, where the branch leaves its parent, m,
    #: rad, and m north, east, down from the opening.
    measured_depth: float
    inclination: float
    azimuth: float
    position: tuple[float, float, float]
    #: Measured depth of the last station of the branch, m; of the kick-off point if the branch has no station.
    end: float


def branches(surveys: SurveyList) -> tuple[Branch, ...]:
    """Return the branches of a list in the order in which they were begun; empty for a hole without branches."""
    found = []
    for leg in surveys.legs:
        if leg.parent:
            at = leg.tie_on
            end = float(surveys.definitive(leg.name).md[-1])
            place = (at.north, at.east, at.vertical_depth)
            found.append(
                Branch(
                    leg.name,
                    leg.parent,
                    leg.name == surveys.leg,
                    at.measured_depth,
                    at.inclination,
                    at.azimuth,
                    place,
                    end,
                )
            )
    return tuple(found)


def legs_of(surveys: SurveyList, path: Definitive) -> tuple[str, ...]:
    """Return, for each station of a path of the list, the name of the leg to which the station belongs."""
    lineage = _lineage(surveys, path.leg)
    return tuple(next((name for name, start in reversed(lineage) if depth > start), lineage[0][0]) for depth in path.md)


def others(surveys: SurveyList, path: Definitive) -> tuple[tuple[str, Array], ...]:
    """
    Return the parts of the hole that are not on the given path: name of the leg, and positions.

    positions: shape (n, 3), north, east, down from the opening, m. The first position is the point where that leg
    leaves the path or its own parent. Legs without a station of their own below this point are left out.
    """
    lineage = _lineage(surveys, path.leg)
    # A leg may leave its parent above the point where the parent itself begins: then the path contains no part of the
    # parent.
    starts = np.minimum.accumulate([start for _, start in reversed(lineage)])[::-1]
    left = {name: float(start) for (name, _), start in zip(lineage[:-1], starts[1:], strict=True)}
    parts = []
    for leg in surveys.legs:
        if leg.name == path.leg:
            continue
        whole = surveys.definitive(leg.name)
        start = left.get(leg.name, leg.tie_on.measured_depth)
        # The hole above the beginning of the leg belongs to the parent leg.
        start = max(start, leg.tie_on.measured_depth) if leg.parent else start
        below = whole.md > start
        if np.any(below) and whole.md[0] <= start:
            parts.append((leg.name, np.vstack([whole.at(start)[2], whole.positions[below]])))
    return tuple(parts)


def _lineage(surveys: SurveyList, name: str) -> list[tuple[str, float]]:
    """Return the legs from the main leg down to a given leg: name, and measured depth at which the leg begins, m."""
    legs = [surveys.find_leg(name)]
    while legs[-1].parent:
        legs.append(surveys.find_leg(legs[-1].parent))
    return [(leg.name, leg.tie_on.measured_depth) for leg in reversed(legs)]


# Deviation from the design.

# Length of the straight continuation ahead of the bit, and distance between its stations, m. The hole is nearly
# straight over this length, which is drilled in less than a shift.
_REACH, _STEP = 30.0, 10.0


@dataclasses.dataclass(frozen=True)
class Deviation:
    """Deviation at one station; unknown numbers are NaN."""

    station: str  #: number of the survey; empty without a survey
    leg: str  #: leg to which the station belongs
    kind: str  #: kind of station as in a path, or "planned" ahead of the bit
    measured_depth: float  #: measured depth of the station, m
    #: `inclination`, `azimuth`: direction of the hole at the station, rad.
    inclination: float
    azimuth: float
    #: `right`, `up`: offset of the hole from the design, across the design, m, negative to the left and below.
    right: float
    up: float
    #: `sigma_right`, `sigma_up`: 1 sigma of `right` and `up`, m.
    sigma_right: float
    sigma_up: float
    distance: float  #: distance of the hole from the design, m
    #: `x`, `y`, `z`: mine coordinates, m, north, east and up; NaN for an axis on which the opening is not given.
    x: float
    y: float
    z: float


def deviations(surveys: SurveyList, path: Definitive) -> tuple[Deviation, ...]:
    """Return the deviation of a path of the list from the plan of the list; empty without a plan or a survey."""
    plan = surveys.plan
    if plan is None or path.md.size < 2:
        return ()
    longer = _straight_on(path)
    covariance = uncertain(surveys, longer).covariance
    opening = surveys.well.mine.opening
    legs = legs_of(surveys, longer)
    rows = []
    for k, (position, inclination, azimuth) in enumerate(
        zip(longer.positions, longer.inclination, longer.azimuth, strict=True)
    ):
        offset = offset_from(plan, position, float(inclination), float(azimuth))
        sigma = np.full(2, math.nan)
        if covariance is not None:
            axes = across(plan, offset.plan_md)
            sigma = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", axes, covariance[k], axes), 0.0))
        rows.append(
            Deviation(
                station=str(longer.sequence[k] or ""),
                leg=legs[k],
                kind=longer.kind[k],
                measured_depth=float(longer.md[k]),
                inclination=float(inclination),
                azimuth=float(azimuth),
                right=offset.right,
                up=offset.up,
                sigma_right=float(sigma[0]),
                sigma_up=float(sigma[1]),
                distance=offset.distance,
                x=opening[0] + float(position[0]),
                y=opening[1] + float(position[1]),
                z=opening[2] - float(position[2]),
            )
        )
    return tuple(rows)


def is_ahead(row: Deviation) -> bool:
    """Return whether a row belongs to a station ahead of the bit."""
    return row.kind == AHEAD


def _straight_on(path: Definitive) -> Definitive:
    """Return the path with a straight continuation of `_REACH` m from its end."""
    inclination, azimuth = float(path.inclination[-1]), float(path.azimuth[-1])
    line = plan_of([0.0, _REACH], [inclination] * 2, [azimuth] * 2, path.positions[-1])
    return continued(path, line, _REACH, _STEP)


# Closure on a surveyed point.

CONSISTENT, DOUBTFUL, INCONSISTENT, UNKNOWN = "consistent", "doubtful", "not consistent", "not known"
# Limits of the probability of a larger closure error by chance. Below the first limit the closure is doubtful, below
# the second it is not consistent. The verdict of a survey uses the same limits.
_DOUBTFUL, _INCONSISTENT = 0.01, 0.001
_SAME = 1e-3  # a station at most this far from the surveyed point in measured depth lies at the point, m


@dataclasses.dataclass(frozen=True)
class Closure:
    """Closure error at a surveyed point; unknown numbers are NaN."""

    leg: str  #: leg of the hole that reaches the point
    measured_depth: float = math.nan  #: measured depth of the point, m
    #: `right`, `up`, `along`: components of the closure error, looking along the hole, m; negative if the path is to
    #: the left of the point, below it, or short of it.
    right: float = math.nan
    up: float = math.nan
    along: float = math.nan
    #: `sigma_right`, `sigma_up`, `sigma_along`: 1 sigma of the path in these directions, m.
    sigma_right: float = math.nan
    sigma_up: float = math.nan
    sigma_along: float = math.nan
    sigma_point: float = math.nan  #: 1 sigma of the point in each direction, m
    distance: float = math.nan  #: length of the closure error, m
    probability: float = math.nan  #: probability of an error at least as large by chance
    verdict: str = UNKNOWN  #: `CONSISTENT`, `DOUBTFUL`, `INCONSISTENT` or `UNKNOWN`
    note: str = ""  #: reason and remedy if a number is unknown; otherwise empty


def closure(surveys: SurveyList, path: Definitive) -> Closure | None:
    """
    Return the closure of a path of the list on the surveyed point of the well; None if no point is given.

    If the point belongs to another leg, the path of that leg is used. If the closure error cannot be computed, the
    result has only a note with the reason.
    """
    mine = surveys.well.mine
    point, opening = mine.closure_point, mine.opening
    leg = mine.closure_leg or path.leg
    if np.isnan(point).all():
        return None
    if np.isnan(point).any() or np.isnan(opening).any():
        return Closure(
            leg, note="x, y and z of the surveyed point and of the opening are needed; give the missing ones"
        )
    if leg != path.leg:
        try:
            path = surveys.definitive(leg)
        except ValueError:
            return Closure(leg, note="the hole has no leg of this name; correct closure_leg")
    depth = float(path.md[-1]) if mine.closure_depth is None else mine.closure_depth
    if path.md.size < 2 or not path.md[0] <= depth <= path.md[-1]:
        text = "the path does not reach the depth of the surveyed point; survey further or correct closure_depth"
        return Closure(leg, depth, sigma_point=mine.closure_sigma, note=text)
    there, k = _with_station(path, depth)
    error = there.positions[k] - [point[0] - opening[0], point[1] - opening[1], opening[2] - point[2]]
    axes = _looking_along(float(there.inclination[k]), float(there.azimuth[k]))
    right, up, along = (float(value) for value in axes @ error)
    found = uncertain(surveys, there)
    sigmas, probability = np.full(3, math.nan), math.nan
    if found.covariance is not None and np.isfinite(found.covariance[k]).all():
        own = axes @ found.covariance[k] @ axes.T
        sigmas = np.sqrt(np.maximum(np.diagonal(own), 0.0))
        both = own + mine.closure_sigma**2 * np.eye(3)
        probability = exceeded(float(axes @ error @ np.linalg.solve(both, axes @ error)), 3)
    return Closure(
        leg,
        depth,
        right,
        up,
        along,
        sigma_right=float(sigmas[0]),
        sigma_up=float(sigmas[1]),
        sigma_along=float(sigmas[2]),
        sigma_point=mine.closure_sigma,
        distance=float(np.linalg.norm(error)),
        probability=probability,
        verdict=_verdict_of(probability),
        note=found.note if math.isnan(probability) else "",
    )


def _verdict_of(probability: float) -> str:
    if math.isnan(probability):
        return UNKNOWN
    return INCONSISTENT if probability < _INCONSISTENT else DOUBTFUL if probability < _DOUBTFUL else CONSISTENT


def _looking_along(inclination: float, azimuth: float) -> Array:
    """Return unit vectors to the right, up and along the hole as rows of a matrix (north, east, down), shape (3, 3)."""
    mat = mat_nt(inclination, azimuth_at(inclination, azimuth), 0.0)
    # At toolface 0 the scribe line is the high side, and the right side is minus the second axis.
    return np.stack([-mat[:, 1], mat[:, 2], mat[:, 0]])


def _with_station(path: Definitive, depth: float) -> tuple[Definitive, int]:
    """
    Return the path with a station at a measured depth, m, and the index of this station.

    The station is inserted if the path has no station at this depth.
    """
    k = int(np.argmin(np.abs(path.md - depth)))
    if abs(float(path.md[k]) - depth) <= _SAME:
        return path, k
    k = int(np.searchsorted(path.md, depth))
    inclination, azimuth, position = path.at(depth)
    md, inc, azi = (
        np.insert(values, k, value)
        for values, value in ((path.md, depth), (path.inclination, inclination), (path.azimuth, azimuth))
    )
    longer = path.through(
        (md, *mc.checked_stations(md, inc, azi)[1:]),
        np.insert(path.positions, k, position, axis=0),
        (*path.kind[:k], path.kind[k], *path.kind[k:]),
        (*path.sequence[:k], 0, *path.sequence[k:]),
    )
    return longer, k
