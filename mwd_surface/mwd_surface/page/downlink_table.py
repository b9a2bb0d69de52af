# SPDX-License-Identifier: Apache-2.0
"""Table of the downlink command for the page."""

from __future__ import annotations

from typing import Any

from mwd_sensors.core.units import LPM, RPM
from mwd_sensors.telemetry.downlink import ROTATION
from mwd_surface.downlink.machine import DownlinkState
from mwd_surface.downlink.status import DownlinkStatus
from mwd_surface.page.plain import number


def downlink_table(status: DownlinkStatus | None) -> dict[str, Any]:
    """Return the downlink as a plain table; only known: False if there is none."""
    if status is None:
        return {"known": False}
    turns = status.medium == ROTATION
    scale, unit = (RPM, "r/min") if turns else (LPM, "l/min")
    return {
        "known": True,
        "number": status.number,
        "state": DownlinkState(status.state).name.lower(),
        "about": status.about,
        "requested_by": status.requested_by,
        "decided_by": status.decided_by,
        "reason": status.reason,
        "blocked_by": list(status.blocked_by),
        "symbol": status.symbol,
        "symbols": status.symbols,
        "remaining": number(status.remaining),
        "medium": status.medium,
        "unit": unit,
        "base": None if status.base is None else number(status.base / scale),
        "set_point": None if status.set_point is None else number(status.set_point / scale),
        "choices": [[name, list(values)] for name, values in status.choices],
    }
