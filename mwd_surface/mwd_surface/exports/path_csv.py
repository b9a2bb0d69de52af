# SPDX-License-Identifier: Apache-2.0
"""path.csv: position, curvature and position uncertainty of every station, with all digits, for programs."""

from __future__ import annotations

import csv
import io
import math

import numpy as np

from mwd_surface.exports.survey_table import SurveyTable
from mwd_surface.uncertainty.position_covariance import ellipse

COLUMNS = (
    "md_m",
    "inclination_deg",
    "azimuth_deg",
    "tvd_m",
    "north_m",
    "east_m",
    "dls_deg_30m",
    "sigma_north_m",
    "sigma_east_m",
    "sigma_tvd_m",
    "vertical_section_m",
    "ellipse_major_m",
    "ellipse_minor_m",
    "ellipse_azimuth_deg",
    "azimuth_reference",
    "station",
    "survey",
    "tool",
    "coordinates",
)


def path_csv(table: SurveyTable) -> str:
    """
    Return the path as text: one line per station, from the tie-on down; the projection to the bit, if any, last.

    Sigmas and the horizontal ellipse (half axes; azimuth of the major one) are at 1 sigma, empty if unknown.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    path, north = table.path, table.path.north.name.lower()
    for k in table.rows:
        record = table.records[k]
        n, e, down = path.positions[k]
        writer.writerow(
            [
                *map(_exact, (path.md[k], math.degrees(path.inclination[k]), math.degrees(path.azimuth[k]))),
                *map(_exact, (down, n, e, math.degrees(path.dogleg_severity[k]) * 30.0)),
                *_uncertainty(table, k)[:3],
                _exact(path.vertical_section[k]),
                *_uncertainty(table, k)[3:],
                north,
                path.kind[k],
                record.survey.sequence if record is not None else "",
                record.tool if record is not None else "",
                "assumed" if path.assumed else "",
            ]
        )
    return out.getvalue()


def _uncertainty(table: SurveyTable, k: int) -> list[str]:
    """Return sigma north, east and down, and the horizontal ellipse, as text."""
    if table.covariance is None or not np.all(np.isfinite(table.covariance[k])):
        return [""] * 6
    covariance = table.covariance[k]
    sigmas = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    flat = ellipse(covariance[:2, :2], sigmas=1.0)
    return [_exact(value) for value in (*sigmas, flat.major, flat.minor, math.degrees(flat.angle))]


def _exact(value: float) -> str:
    """Return a number with ten decimals, without a minus before zero."""
    return f"{float(value) + 0.0:.10f}" if abs(value) >= 5e-11 else f"{0.0:.10f}"
