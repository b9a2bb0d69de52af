"""The driller's page in one line of a terminal: angles, toolface, depth, surveys, recorder; silence is a dash."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

_RECORDER = {"recording": "rec"}


def live_words(sections: Mapping[str, Any]) -> str:
    """
    One line of what `LiveState.snapshot` holds.

    sections : its sections by name; missing ones read as silence. Values that are stale are marked with their age.
    """
    attitude, rig = sections.get("attitude", {}), sections.get("rig", {})
    toolface = sections.get("toolface", {})
    north = attitude.get("north", "")
    rows = sections.get("surveys", {}).get("rows", [])
    recorder = sections.get("recorder", {})
    parts = [
        f"incl {_angle(attitude.get('inclination'))}",
        f"azi {_angle(attitude.get('azimuth'))}" + (f" {north}" if north else ""),
        f"{'mtf' if toolface.get('mode') == 'magnetic' else 'gtf'} {_angle(toolface.get('angle'), 0)}",
        f"bit {_number(rig.get('bit_depth'))} m",
        f"{len(rows)} survey" + ("" if len(rows) == 1 else "s"),
        f"{_RECORDER.get(recorder.get('state'), recorder.get('state', 'no recorder'))} {recorder.get('messages', 0)}",
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
