# SPDX-License-Identifier: Apache-2.0
"""Clearances as a CSV table: one line per point of the well and offset well, degrees and metres."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

from mwd_surface.clearance.clearance import Clearance
from mwd_surface.signals.cells import fixed

COLUMNS = (
    "offset_well",
    "md_m",
    "offset_md_m",
    "distance_m",
    "allowed_distance_m",
    "separation_factor",
    "level",
    "toolface_deg",
    "bearing_deg",
)


def clearance_csv(found: Sequence[Clearance]) -> str:
    """Return the clearances as CSV text; the offset well with the smallest separation factor comes first."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for other in found:
        for k in range(other.md.size):
            writer.writerow(
                [
                    other.name,
                    fixed(float(other.md[k]), 2),
                    fixed(float(other.offset_md[k]), 2),
                    fixed(float(other.distance[k]), 3),
                    fixed(float(other.allowed[k]), 3),
                    fixed(float(other.factor[k]), 4),
                    other.rule.level(float(other.factor[k])).name.lower(),
                    fixed(math.degrees(other.toolface[k]), 1, 360.0),
                    fixed(math.degrees(other.bearing[k]), 1, 360.0),
                ]
            )
    return out.getvalue()
