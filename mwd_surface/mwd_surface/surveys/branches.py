# SPDX-License-Identifier: Apache-2.0
"""Branches of a hole: the sidetracks of its survey list, each with its kick-off point and its end."""

from __future__ import annotations

import dataclasses

import numpy as np

from mwd_sensors.core.arrays import Array
from mwd_surface.surveys.survey_list import SurveyList
from mwd_surface.trajectory.well_path import Definitive


@dataclasses.dataclass(frozen=True)
class Branch:
    """
    A branch of the hole.

    name, parent: names of the leg that is the branch, and of the leg that the branch leaves.
    current: whether the next surveys belong to the branch.
    measured_depth (m), inclination, azimuth (rad), position (north, east, down from the opening, m): kick-off point,
    where the branch leaves its parent.
    end: measured depth of the last station of the branch, m; of the kick-off point if the branch has no station.
    """

    name: str
    parent: str
    current: bool
    measured_depth: float
    inclination: float
    azimuth: float
    position: tuple[float, float, float]
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
