# SPDX-License-Identifier: Apache-2.0
"""comparison.csv: comparison of two surveys of one hole, at the measured depths of the stations of the first survey."""

from __future__ import annotations

import math

from mwd_surface.signals.cells import fixed, table
from mwd_surface.trajectory.list_comparison import PathDifference

COLUMNS = (
    "md_m",
    "inclination_deg",
    "other_inclination_deg",
    "difference_inclination_deg",
    "azimuth_deg",
    "other_azimuth_deg",
    "difference_azimuth_deg",
    "difference_north_m",
    "difference_east_m",
    "difference_tvd_m",
    "distance_m",
    "sigma_difference_north_m",
    "sigma_difference_east_m",
    "sigma_difference_tvd_m",
    "distance_sigmas",
)


def comparison_csv(found: PathDifference) -> str:
    """Return the table as text; differences are the first list minus the second list, unknown sigmas are empty."""
    lines = []
    for k in range(found.md.size):
        angles = [
            math.degrees(angle)
            for both, turn in ((found.inclination[k], found.turn[k, 0]), (found.azimuth[k], found.turn[k, 1]))
            for angle in (*both, turn)
        ]
        values = (found.md[k], *angles, *found.position[k], found.distance[k], *found.sigma[k], found.sigmas[k])
        lines.append({name: fixed(float(value), 6) for name, value in zip(COLUMNS, values, strict=True)})
    return table(COLUMNS, lines)
