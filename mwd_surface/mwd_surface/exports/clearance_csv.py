# SPDX-License-Identifier: Apache-2.0
"""Clearances as a CSV table: one line per point of the well and offset well, degrees and metres."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from mwd_surface.clearance.clearance import Clearance
from mwd_surface.signals.cells import fixed, table

# Each column, and the text of its cell at a point of the well.
_COLUMNS: dict[str, Callable[[Clearance, int], str]] = {
    "offset_well": lambda other, _k: other.name,
    "md_m": lambda other, k: fixed(float(other.md[k]), 2),
    "offset_md_m": lambda other, k: fixed(float(other.offset_md[k]), 2),
    "distance_m": lambda other, k: fixed(float(other.distance[k]), 3),
    "allowed_distance_m": lambda other, k: fixed(float(other.allowed[k]), 3),
    "separation_factor": lambda other, k: fixed(float(other.factor[k]), 4),
    "level": lambda other, k: other.rule.level(float(other.factor[k])).name.lower(),
    "toolface_deg": lambda other, k: fixed(math.degrees(other.toolface[k]), 1, 360.0),
    "bearing_deg": lambda other, k: fixed(math.degrees(other.bearing[k]), 1, 360.0),
}


def clearance_csv(found: Sequence[Clearance]) -> str:
    """Return the clearances as CSV text; the offset well with the smallest separation factor comes first."""
    points = ((other, k) for other in found for k in range(other.md.size))
    return table(tuple(_COLUMNS), ({name: cell(*point) for name, cell in _COLUMNS.items()} for point in points))
