# SPDX-License-Identifier: Apache-2.0
"""Deviation from the designed hole as CSV: at every station, at the bit, and along the projected hole ahead."""

from __future__ import annotations

import math

from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals import cells
from mwd_surface.surveys.mine_hole import is_ahead
from mwd_surface.trajectory.well_path import PROJECTED

_LENGTHS = {
    "right_of_design_m": "right",
    "sigma_right_m": "sigma_right",
    "above_design_m": "up",
    "sigma_above_m": "sigma_up",
    "to_design_m": "distance",
    "mine_x_m": "x",
    "mine_y_m": "y",
    "mine_z_m": "z",
}
_DEG = 180.0 / math.pi


def deviation_csv(table: SurveyTable) -> str:
    """
    Return the deviations as text: left and below are negative; x north, y east and z up are mine coordinates.

    A mine coordinate is empty on an axis on which the opening of the hole is not given. The vertical angle has the
    convention of the well. Rows at the bit and ahead of it are projected. Without a design there are no rows, but a
    comment.
    """
    rows = table.deviations
    angles = table.surveys.well.angles
    names = (
        "survey",
        "station",
        "leg",
        "ahead",
        "md_m",
        angles.column,
        "azimuth_deg",
        "azimuth_reference",
        *_LENGTHS,
        "coordinates",
    )
    lines = [
        {
            "survey": row.station,
            "station": PROJECTED if is_ahead(row) else row.kind,
            "leg": row.leg,
            "ahead": "yes" if is_ahead(row) else "no",
            "md_m": cells.fixed(row.measured_depth, 3),
            angles.column: cells.fixed(angles.shown(row.inclination) * _DEG, 4),
            "azimuth_deg": cells.fixed(row.azimuth * _DEG, 4, 360.0),
            "azimuth_reference": table.path.north.name.lower(),
            **{name: cells.fixed(getattr(row, field), 3) for name, field in _LENGTHS.items()},
            "coordinates": "assumed" if table.path.assumed else "",
        }
        for row in rows
    ]
    head = "" if rows else "# no row: the list has no survey or no design; give the design with --plan\n"
    return head + cells.table(names, lines)
