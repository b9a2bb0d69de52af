# SPDX-License-Identifier: Apache-2.0
"""Clearances as a CSV table: one line per point of the well and offset well, degrees and metres."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mwd_surface.clearance.clearance import Clearance
from mwd_surface.signals.cells import fixed, table


def clearance_csv(found: Sequence[Clearance]) -> str:
    """Return the clearances as CSV text; the offset well with the smallest separation factor comes first."""
    lines = [
        {
            "offset_well": other.name,
            "md_m": fixed(float(other.md[k]), 2),
            "offset_md_m": fixed(float(other.offset_md[k]), 2),
            "distance_m": fixed(float(other.distance[k]), 3),
            "allowed_distance_m": fixed(float(other.allowed[k]), 3),
            "separation_factor": fixed(float(other.factor[k]), 4),
            "level": other.rule.level(float(other.factor[k])).name.lower(),
            "toolface_deg": fixed(math.degrees(other.toolface[k]), 1, 360.0),
            "bearing_deg": fixed(math.degrees(other.bearing[k]), 1, 360.0),
        }
        for other in found
        for k in range(other.md.size)
    ]
    return table(tuple(lines[0]), lines)
