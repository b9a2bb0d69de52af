# SPDX-License-Identifier: Apache-2.0
"""
Deviation of a hole from its design: left or right and up or down at every station, at the bit and ahead of it.

The offsets are at right angles to the design (`trajectory.plan.offset_from`). Their sigmas come from the position
covariance of the error model, in the same two directions. Ahead of the bit the hole is continued straight; the stations
there count as stations of the tool in the hole, so that their sigmas grow with the error of the hole's direction.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mwd_surface.surveys.branches import legs_of
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.surveys.well_position import AHEAD, continued, uncertain
from mwd_surface.trajectory.plan import across, offset_from, plan_of
from mwd_surface.trajectory.well_path import Definitive

# Length of the straight continuation ahead of the bit, and distance between its stations, m. The hole is nearly
# straight over this length, which is drilled in less than a shift.
_REACH, _STEP = 30.0, 10.0


@dataclasses.dataclass(frozen=True)
class Deviation:
    """
    Deviation at one station; unknown numbers are NaN.

    station: number of the survey; empty without a survey.
    leg: leg to which the station belongs.
    kind: kind of station as in a path, or "planned" ahead of the bit.
    measured_depth: m.
    inclination, azimuth: rad.
    right, up: offset of the hole from the design, across the design, m, negative to the left and below.
    sigma_right, sigma_up: 1 sigma, m.
    distance: distance of the hole from the design, m.
    x, y, z: mine coordinates, m, north, east and up; NaN for an axis on which the opening is not given.
    """

    station: str
    leg: str
    kind: str
    measured_depth: float
    inclination: float
    azimuth: float
    right: float
    up: float
    sigma_right: float
    sigma_up: float
    distance: float
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
