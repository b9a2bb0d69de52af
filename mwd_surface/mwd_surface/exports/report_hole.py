# SPDX-License-Identifier: Apache-2.0
"""The rod table in the report of a mine hole: dip, azimuth and deviation from the design at every survey."""

from __future__ import annotations

import math

from mwd_surface.exports.report_section import Section, sheet_of
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals.cells import fixed
from mwd_surface.surveys.deviation import is_ahead
from mwd_surface.trajectory.well_path import PROJECTED

_DEG = 180.0 / math.pi


def deviation(table: SurveyTable) -> Section | None:
    """Return the rod table of a mine hole; None for a hole in inclinations or without a design."""
    angles, rows = table.surveys.well.angles, table.deviations
    if not angles.points or not rows:
        return None
    columns = (
        *(("Survey", ""), ("Depth", "m"), (angles.heading, "deg"), ("Azi", "deg")),
        *(("Right of design", "m"), ("1σ", "m"), ("Above design", "m"), ("1σ", "m")),
        *(("x, north", "m"), ("y, east", "m"), ("z, up", "m")),
    )
    cells = [
        (
            row.station or ("ahead" if is_ahead(row) else row.kind),
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
        "Across the design, looking along it: negative numbers lie to the left or below. Shaded lines were not "
        "surveyed; ahead of the bit the hole is continued straight."
    )
    sheet = sheet_of("Rod table and deviation from the design", columns, cells, marks, legend=legend)
    return Section(sheet.heading, sheets=(sheet,))
