# SPDX-License-Identifier: Apache-2.0
"""
Closure of a hole on a surveyed point: comparison of the computed path with a point of known coordinates.

Such a point is, for example, the place where the hole breaks through into a roadway. The closure error is the position
of the path minus the position of the point, seen looking along the hole: right or left, up or down, and along. A
chi-square test compares the closure error with the covariances of path and point.
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
from mwd_surface.surveys.well_position import uncertain
from mwd_surface.trajectory.plan import azimuth_at
from mwd_surface.trajectory.well_path import Definitive

CONSISTENT, DOUBTFUL, INCONSISTENT, UNKNOWN = "consistent", "doubtful", "not consistent", "not known"
# Limits of the probability of a larger closure error by chance. Below the first limit the closure is doubtful, below
# the second it is not consistent. The verdict of a survey uses the same limits.
_DOUBTFUL, _INCONSISTENT = 0.01, 0.001
_SAME = 1e-3  # a station at most this far from the surveyed point in measured depth lies at the point, m


@dataclasses.dataclass(frozen=True)
class Closure:
    """
    Closure error at a surveyed point; unknown numbers are NaN.

    leg: leg of the hole that reaches the point.
    measured_depth: measured depth of the point, m.
    right, up, along: components of the closure error, looking along the hole, m; negative if the path is to the left of
    the point, below it, or short of it.
    sigma_right, sigma_up, sigma_along: 1 sigma of the path in these directions, m.
    sigma_point: 1 sigma of the point in each direction, m.
    distance: length of the closure error, m.
    probability: probability of an error at least as large by chance.
    verdict: `CONSISTENT`, `DOUBTFUL`, `INCONSISTENT` or `UNKNOWN`.
    note: reason and remedy if a number is unknown; otherwise empty.
    """

    leg: str
    measured_depth: float = math.nan
    right: float = math.nan
    up: float = math.nan
    along: float = math.nan
    sigma_right: float = math.nan
    sigma_up: float = math.nan
    sigma_along: float = math.nan
    sigma_point: float = math.nan
    distance: float = math.nan
    probability: float = math.nan
    verdict: str = UNKNOWN
    note: str = ""


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
        verdict=_verdict(probability),
        note=found.note if math.isnan(probability) else "",
    )


def _verdict(probability: float) -> str:
    if math.isnan(probability):
        return UNKNOWN
    return INCONSISTENT if probability < _INCONSISTENT else DOUBTFUL if probability < _DOUBTFUL else CONSISTENT


def _looking_along(inclination: float, azimuth: float) -> Array:
    """Return unit vectors to the right, up and along the hole as rows of a matrix (north, east, down), shape (3, 3)."""
    mat = mat_nt(inclination, azimuth_at(inclination, azimuth), 0.0)
    # At toolface 0 the scribe line is the high side, and the right side is minus the second axis.
    return np.stack([-mat[:, 1], mat[:, 2], mat[:, 0]])


def _with_station(path: Definitive, depth: float) -> tuple[Definitive, int]:
    """Return the path with a station at a measured depth, m, inserted if it has none there, and its index."""
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
