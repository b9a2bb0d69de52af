# SPDX-License-Identifier: Apache-2.0
"""
Log samples of a recording, and the limits of the tool, as the surface node used them live.

The limits are a table of the recording, so that a viewer and `mwd report` use those of the live surface.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from mwd_sensors.core import settings
from mwd_sensors.telemetry import tool_configuration
from mwd_sensors.telemetry.log_channels import LogSample
from mwd_sensors.telemetry.tool_limits import ToolLimits
from mwd_surface.bags.bag_reader import Bag, BagError

TOPICS = ("log", "link/log")
RIG = "rig/state"
#: Values of the setting `link.source`: the surface receives the tool directly, or over all of the tool's links.
DIRECT, BEST = "direct", "best"


def of_link(sample: LogSample, source: str) -> bool:
    """Return whether a surface with this setting `link.source` uses a sample."""
    return source in (DIRECT, BEST) or sample.link in ("", source)


def recorded_samples(bag: Bag, well: str = "", source: str = DIRECT) -> list[LogSample]:
    """
    Return the log samples that a recording holds, in order of recording.

    Samples received directly from the tool are preferred to samples received over a link. well: namespace of the well,
    if the recording has several. source: setting `link.source` of the surface.

    Raises
    ------
    BagError
        The recording has no log samples, or it has log samples of several wells and `well` is empty.
    """
    for relative in TOPICS:
        name = topic_of(bag, relative, LogSample.MESSAGE, well)
        if name is not None:
            found = (LogSample.from_message(bag.decode(name, data)) for _, _, _, data in bag.messages([name]))
            return [sample for sample in found if of_link(sample, source)]
    raise BagError(
        f"{bag.path} has no log samples" + (f" of {well}" if well else ""),
        "if it has pulse counts and an IMU, compute the log samples with `--compute`",
    )


def topic_of(bag: Bag, relative: str, type_name: str, well: str = "") -> str | None:
    """
    Return the topic of a well by its relative name; None if the recording has no message of it.

    Raises
    ------
    BagError
        Several wells have this topic, and `well` is empty.
    """
    wanted = f"/{well.strip('/')}/{relative}" if well.strip("/") else f"/{relative}"
    names = [t.name for t in bag.topics.values() if t.type_name == type_name and t.count]
    exact = [name for name in names if "/" + name.strip("/") == wanted]
    found = exact or [name for name in names if ("/" + name.strip("/")).endswith(wanted)]
    # Leave out `link/log` if `log` is wanted: its name ends with /log too.
    found = [name for name in found if relative.startswith("link/") or not name.strip("/").endswith("link/" + relative)]
    if len(found) > 1:
        raise BagError(f"{bag.path} has {relative} of several wells: {', '.join(found)}", "name one with --well")
    return found[0] if found else None


def namespace_with(bag: Bag, topics: Mapping[str, str], well: str = "") -> str | None:
    """
    Return the namespace, with a slash at its end, of the first of the given topics that has messages in a recording.

    topics: type of the messages by relative topic. Return None if no topic has a message in the recording.

    Raises
    ------
    BagError
        Several wells have the topic, and `well` is empty.
    """
    for relative, type_name in topics.items():
        name = topic_of(bag, relative, type_name, well)
        if name is not None:
            return name.removesuffix(relative)
    return None


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
