# SPDX-License-Identifier: Apache-2.0
"""Limits of the tool as a table of a recording, so that a viewer and `mwd report` use those of the live surface."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from mwd_sensors.core import settings
from mwd_sensors.telemetry import tool_configuration
from mwd_sensors.telemetry.tool_limits import ToolLimits

TOOL = "tool"  # name of the table
FILE = "tool_health.json"  # file with the same table in the folder of the survey list
_HEALTH = "health"


def read_limits(tool_file: str) -> ToolLimits | None:
    """
    Return the limits in a tool file; None without a file.

    Raises ValueError, OSError as `tool_configuration.read_several` does.
    """
    if not tool_file:
        return None
    (tool,) = tool_configuration.read_several([Path(tool_file).expanduser()])
    return tool.health


def limits_table(limits: ToolLimits | None) -> dict[str, str]:
    """Return the limits as a table for a recording; empty without limits."""
    return {} if limits is None else {_HEALTH: json.dumps(settings.to_mapping(limits))}


def recorded_limits(table: Mapping[str, str]) -> ToolLimits | None:
    """Return the limits in a table of a recording; None if the table has none, or this version cannot read them."""
    try:
        return settings.from_mapping(ToolLimits, json.loads(table[_HEALTH])) if _HEALTH in table else None
    except (ValueError, TypeError):
        return None


def limits_of_run(path: Path) -> tuple[ToolLimits | None, str]:
    """Return the limits in a file, and a remark if the file cannot be read; None and "" if the file does not exist."""
    try:
        table = json.loads(path.read_bytes())
        limits = recorded_limits(table)
        readable = isinstance(table, dict) and (limits is not None or not table)
    except FileNotFoundError:
        return None, ""
    except (ValueError, TypeError, OSError):
        limits, readable = None, False
    return limits, "" if readable else f"the limits of the tool are not known: {path.name} cannot be read"
