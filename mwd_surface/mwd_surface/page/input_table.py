# SPDX-License-Identifier: Apache-2.0
"""Table of the surface's inputs for the page: clock, offset, age, and which input gives the depth."""

from __future__ import annotations

from typing import Any

from mwd_surface.live.inputs import InputTable, Role
from mwd_surface.page.plain import number

_ROLES = {Role.NO_DEPTH: "", Role.STANDBY: "stands by", Role.IN_FORCE: "in force", Role.SILENT: "silent"}


def input_table(inputs: InputTable) -> dict[str, Any]:
    """Return all inputs; None where unknown."""
    return {
        "depth_source": inputs.depth_source,
        "depth_age": number(inputs.depth_age),
        "depth_difference": number(inputs.depth_difference),
        "rows": [
            {
                "name": row.name,
                "clock": row.clock.name.lower(),
                "offset": number(row.clock_offset),
                "age": number(row.data_age),
                "role": _ROLES[row.role],
                "priority": row.priority,
                "bit_depth": number(row.bit_depth),
                "reason": row.reason,
            }
            for row in inputs.inputs
        ],
    }
