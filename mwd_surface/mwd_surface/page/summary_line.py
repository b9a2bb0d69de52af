# SPDX-License-Identifier: Apache-2.0
"""Line of text for a terminal from the state of the page: angles, toolface, depth, surveys, recorder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

_RECORDER = {"recording": "rec"}


def summary_line(sections: Mapping[str, Any]) -> str:
    """
    Return one line of text for a snapshot of the page.

    sections: sections of the page by name; a missing section reads "-". Stale values carry their age.
    """
    attitude, rig = sections.get("attitude", {}), sections.get("rig", {})
    toolface = sections.get("toolface", {})
    north = attitude.get("north", "")
    rows = sections.get("surveys", {}).get("rows", [])
    recorder: Mapping[str, Any] = sections.get("recorder") or {"state": "no recorder"}
    parts = [
        f"incl {_angle(attitude.get('inclination'))}",
        f"azi {_angle(attitude.get('azimuth'))}" + (f" {north}" if north else ""),
        f"{'mtf' if toolface.get('mode') == 'magnetic' else 'gtf'} {_angle(toolface.get('angle'), 0)}",
        f"bit {_number(rig.get('bit_depth'))} m",
        f"{len(rows)} survey" + ("" if len(rows) == 1 else "s"),
        f"{_RECORDER.get(recorder['state'], recorder['state'])} {recorder.get('messages', 0)}",
    ]
    return "  ".join(parts)


def _angle(value: Mapping[str, Any] | None, decimals: int = 1) -> str:
    return _number(value, decimals, 180.0 / math.pi)


def _number(value: Mapping[str, Any] | None, decimals: int = 1, factor: float = 1.0) -> str:
    if not value or value.get("value") is None:
        return "-"
    text = f"{value['value'] * factor:.{decimals}f}"
    if value.get("state") == "stale" and value.get("age") is not None:
        return f"{text} ({value['age']:.0f} s old)"
    return text
