# SPDX-License-Identifier: Apache-2.0
"""The high-density trajectory in the report: the hole between the stations according to the slide sheet."""

from __future__ import annotations

import numpy as np

from mwd_surface.exports.report_section import Section, sheet_of
from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.exports.trajectory_files import summary
from mwd_surface.signals.cells import fixed
from mwd_surface.trajectory.dense_trajectory import STATION, dense_trajectory

_COLUMNS = (
    ("MD", "m"),
    ("TVD", "m"),
    ("TVD, high density", "m"),
    ("Δ TVD", "m"),
    ("Δ N", "m"),
    ("Δ E", "m"),
)


def high_density(table: SurveyTable) -> Section | None:
    """Return the table of station depths computed with the recorded slides; None without a slide sheet."""
    found = dense_trajectory(table.path, stretches=table.stretches)
    if not found.has_detail:
        return None
    rows = []
    for k in np.flatnonzero([source == STATION for source in found.source]):
        down, (north, east, apart) = found.positions[k, 2], found.differences[k]
        rows.append(tuple(fixed(float(value), 2) for value in (found.md[k], down - apart, down, apart, north, east)))
    sheet = sheet_of("High-density trajectory", _COLUMNS, rows)
    what = (
        "For comparison, not the definitive survey: the dogleg of each interval is assigned to the stretches where the"
    )
    return Section(
        sheet.heading,
        (f"{what} string slid according to the slide sheet, instead of an even arc. {summary(found)}.",),
        sheets=(sheet,),
    )
