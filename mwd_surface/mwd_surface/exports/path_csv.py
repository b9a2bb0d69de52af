# SPDX-License-Identifier: Apache-2.0
"""
path.csv: every station of a path with ten decimals, for programs.

The columns of the definitive survey have the names of all tables (`signals/table.csv`). The columns of the horizontal
error ellipse follow.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.signals import cells
from mwd_surface.signals.table import LISTED
from mwd_surface.uncertainty.position_covariance import ellipse

_DECIMALS = 10  # decimals of every number
_ELLIPSE = ("ellipse_major_m", "ellipse_minor_m", "ellipse_azimuth_deg")
_WORDS = ("azimuth_reference", "station", "sequence", "tool", "coordinates")


def path_csv(table: SurveyTable) -> str:
    """
    Return the path as text: one line per station, from the tie-on down; the projection to the bit, if any, last.

    Sigmas and the horizontal error ellipse (half axes, azimuth of the major axis) are at 1 sigma, empty if unknown.
    """
    path = table.path
    lines: list[dict[str, Any]] = []
    for k in table.rows:
        record = table.records[k]
        numbers = {one.key: cells.fixed(one.values[k], _DECIMALS, one.signal.wrap) for one in table.columns}
        words = {
            "azimuth_reference": path.north.name.lower(),
            "station": path.kind[k],
            "sequence": "" if record is None else record.survey.sequence,
            "tool": "" if record is None else record.tool,
            "coordinates": "assumed" if path.assumed else "",
        }
        lines.append({**numbers, **_ellipse(table, k), **words})
    listed = (signal.column_for_people(column, table.display) for signal, column in LISTED)
    return cells.table((*(column.key for column in listed), *_ELLIPSE, *_WORDS), lines)


def _ellipse(table: SurveyTable, k: int) -> dict[str, str]:
    """Return half axes and azimuth of a station's horizontal ellipse as texts, by column; empty if unknown."""
    if table.covariance is None or not np.all(np.isfinite(table.covariance[k])):
        return {}
    flat = ellipse(table.covariance[k][:2, :2], sigmas=1.0)
    values = (flat.major, flat.minor, math.degrees(flat.angle))
    return {name: cells.fixed(float(value), _DECIMALS) for name, value in zip(_ELLIPSE, values, strict=True)}
