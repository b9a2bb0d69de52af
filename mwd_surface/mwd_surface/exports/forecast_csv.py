# SPDX-License-Identifier: Apache-2.0
"""Forecast of surveys as a CSV table: one line per station of the plan, in m, degrees, nT and milli-g."""

from __future__ import annotations

import csv
import io
import math

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.signals.cells import fixed
from mwd_surface.uncertainty.forecast import Forecast

COLUMNS = (
    "md_m",
    "inclination_deg",
    "azimuth_deg",
    "azimuth_true_deg",
    "sigma_inclination_deg",
    "sigma_azimuth_deg",
    "sigma_azimuth_corrected_deg",
    "limit_gravity_mg",
    "limit_field_nt",
    "limit_dip_deg",
    "accepted",
    "correction_no_go",
)
_DEG = 180.0 / math.pi


def forecast_csv(found: Forecast) -> str:
    """Return the forecast as CSV text; unknown values are empty."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for k in range(found.md.size):
        gravity, field, dip = (float(v) for v in found.limits[k])
        writer.writerow(
            [
                fixed(float(found.md[k]), 2),
                fixed(float(found.inclination[k]) * _DEG, 3),
                fixed(float(found.azimuth[k]) * _DEG, 3, 360.0),
                fixed(float(found.true_azimuth[k]) * _DEG, 3, 360.0),
                fixed(float(found.sigma_inclination[k]) * _DEG, 4),
                fixed(float(found.sigma_azimuth[k]) * _DEG, 4),
                fixed(float(found.sigma_corrected[k]) * _DEG, 4),
                fixed(gravity / (1e-3 * STANDARD_GRAVITY), 3),
                fixed(field * 1e9, 1),
                fixed(dip * _DEG, 3),
                fixed(float(found.accepted[k]), 2),
                "yes" if found.no_go[k] else "no",
            ]
        )
    return out.getvalue()
