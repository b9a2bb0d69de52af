# SPDX-License-Identifier: Apache-2.0
"""Sections of the report of a mine hole: rod table with the deviation from the design, branches, and closure."""

from __future__ import annotations

import math

from mwd_surface.exports.report_section import DOUBTFUL as DOUBTFUL_TINT
from mwd_surface.exports.report_section import GOOD, REJECT, Section, sheet_of
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals.cells import fixed, typed
from mwd_surface.surveys.leg import MAIN
from mwd_surface.surveys.mine_hole import CONSISTENT, DOUBTFUL, INCONSISTENT, branches, is_ahead
from mwd_surface.trajectory.well_path import PROJECTED

_DEG = 180.0 / math.pi


def deviation(table: SurveyTable) -> Section | None:
    """
    Return the section with the rod table of a mine hole.

    None without a design, or for a well with inclination from the vertical.
    """
    angles, rows = table.surveys.well.angles, table.deviations
    if not angles.points or not rows:
        return None
    several = len(table.surveys.legs) > 1
    columns = (
        *(
            ("Survey", ""),
            *((("Leg", ""),) if several else ()),
            ("Depth", "m"),
            (angles.heading, "deg"),
            ("Azi", "deg"),
        ),
        *(("Right of design", "m"), ("1σ", "m"), ("Above design", "m"), ("1σ", "m")),
        *(("x, north", "m"), ("y, east", "m"), ("z, up", "m")),
    )
    cells = [
        (
            row.station or ("ahead" if is_ahead(row) else row.kind),
            *((_leg(row.leg),) if several else ()),
            fixed(row.measured_depth, 2),
            fixed(angles.shown(row.inclination) * _DEG, 2),
            fixed(row.azimuth * _DEG, 2, 360.0),
            fixed(row.right, 2),
            fixed(row.sigma_right, 2),
            fixed(row.up, 2),
            fixed(row.sigma_up, 2),
            *(fixed(value, 2) for value in (row.x, row.y, row.z)),
        )
        for row in rows
    ]
    marks = [PROJECTED if is_ahead(row) or row.kind == PROJECTED else "" for row in rows]
    legend = (
        "Across the design, looking along the hole: negative is left of or below the design. Shaded lines were not "
        "surveyed; ahead of the bit the hole is continued straight."
    )
    sheet = sheet_of("Rod table and deviation from the design", columns, cells, marks, legend=legend)
    return Section(sheet.heading, sheets=(sheet,))


def branched(table: SurveyTable) -> Section | None:
    """
    Return the section with the branches of a mine hole: depth where each branch leaves its parent, and its end.

    None without branches, or for a well with inclination from the vertical.
    """
    well, found = table.surveys.well, branches(table.surveys)
    if not well.angles.points or not found:
        return None
    columns = (
        *(("Branch", ""), ("Leaves", ""), ("At depth", "m"), (well.angles.heading, "deg"), ("Azi", "deg")),
        *(("x, north", "m"), ("y, east", "m"), ("z, up", "m"), ("Reaches", "m")),
    )
    cells = []
    for one in found:
        north, east, down = one.position
        x, y, z = well.mine.opening
        cells.append(
            (
                _leg(one.name),
                _leg(one.parent),
                fixed(one.measured_depth, 2),
                fixed(well.angles.shown(one.inclination) * _DEG, 2),
                fixed(one.azimuth * _DEG, 2, 360.0),
                *(fixed(value, 2) for value in (x + north, y + east, z - down)),
                fixed(one.end, 2),
            )
        )
    legend = "The path of a branch begins on the path of the leg that it leaves."
    sheet = sheet_of("Branches", columns, cells, legend=legend)
    return Section(sheet.heading, sheets=(sheet,))


def closed(table: SurveyTable) -> Section | None:
    """Return the section with the closure of a mine hole on its surveyed point; None if no point is given."""
    found = table.closure
    if found is None:
        return None
    columns = (
        *(("Leg", ""), ("Depth", "m"), ("Right", "m"), ("1σ", "m"), ("Above", "m"), ("1σ", "m"), ("Along", "m")),
        *(("1σ", "m"), ("Distance", "m"), ("Point, 1σ", "m"), ("By chance", "%"), ("Closure", "")),
    )
    numbers = (
        *(found.measured_depth, found.right, found.sigma_right, found.up, found.sigma_up),
        *(found.along, found.sigma_along, found.distance, found.sigma_point),
    )
    cells = (_leg(found.leg), *(fixed(value, 2) for value in numbers), fixed(100.0 * found.probability, 2))
    tint = {CONSISTENT: GOOD, DOUBTFUL: DOUBTFUL_TINT, INCONSISTENT: REJECT}.get(found.verdict)
    legend = (
        "Position of the computed path minus that of the surveyed point, looking along the hole: negative numbers lie "
        "to the left, below, or short of the point. 1σ is that of the path. The closure is consistent if an error of "
        "this size comes by chance in more than one of a hundred holes, and not consistent below one of a thousand."
    )
    sheet = sheet_of(
        "Closure on the surveyed point",
        columns,
        [(*cells, found.verdict)],
        tints={(0, len(columns) - 1): tint} if tint else {},
        legend=legend,
    )
    return Section(sheet.heading, (f"{found.note}.",) if found.note else (), sheets=(sheet,))


def _leg(name: str) -> str:
    """Return the name of a leg; the name of the main leg is a word of the program, and therefore translated."""
    return name if name == MAIN else typed(name)
