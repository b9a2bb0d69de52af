# SPDX-License-Identifier: Apache-2.0
"""Forecast of surveys as a CSV table: one line per station of the plan, in m, degrees, nT and milli-g."""

from __future__ import annotations

import math
from collections.abc import Callable

from mwd_sensors.core.constants import STANDARD_GRAVITY
from mwd_surface.signals.cells import fixed, table
from mwd_surface.uncertainty.forecast import Forecast

# Each column, and the text of its cell at a station.
_COLUMNS: dict[str, Callable[[Forecast, int], str]] = {
    "md_m": lambda found, k: fixed(float(found.md[k]), 2),
    "inclination_deg": lambda found, k: fixed(math.degrees(found.inclination[k]), 3),
    "azimuth_deg": lambda found, k: fixed(math.degrees(found.azimuth[k]), 3, 360.0),
    "azimuth_true_deg": lambda found, k: fixed(math.degrees(found.true_azimuth[k]), 3, 360.0),
    "sigma_inclination_deg": lambda found, k: fixed(math.degrees(found.sigma_inclination[k]), 4),
    "sigma_azimuth_deg": lambda found, k: fixed(math.degrees(found.sigma_azimuth[k]), 4),
    "sigma_azimuth_corrected_deg": lambda found, k: fixed(math.degrees(found.sigma_corrected[k]), 4),
    "limit_gravity_mg": lambda found, k: fixed(float(found.limits[k, 0]) / (1e-3 * STANDARD_GRAVITY), 3),
    "limit_field_nt": lambda found, k: fixed(float(found.limits[k, 1]) * 1e9, 1),
    "limit_dip_deg": lambda found, k: fixed(math.degrees(found.limits[k, 2]), 3),
    "accepted": lambda found, k: fixed(float(found.accepted[k]), 2),
    "correction_no_go": lambda found, k: "yes" if found.no_go[k] else "no",
}


def forecast_csv(found: Forecast) -> str:
    """Return the forecast as CSV text; unknown values are empty."""
    lines = ({name: cell(found, k) for name, cell in _COLUMNS.items()} for k in range(found.md.size))
    return table(tuple(_COLUMNS), lines)
