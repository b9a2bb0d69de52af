# SPDX-License-Identifier: Apache-2.0
"""Logs over depth and health of the tool of a finished run, from its folder or from a recording."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from mwd_sensors.telemetry.log_channels import LogSample
from mwd_surface.bags.bag_reader import Bag
from mwd_surface.logs.depth_log import DepthLog
from mwd_surface.logs.log_journal import NAME, lines_of, restore
from mwd_surface.logs.recorded_log import TOPICS, namespace_with
from mwd_surface.logs.tool_health import HealthLedger, ToolHealth
from mwd_surface.logs.tool_table import FILE, limits_of_run
from mwd_surface.runs.player import OF_DEPTH, Player

_PLAYED = {**OF_DEPTH, **dict.fromkeys(TOPICS, LogSample.MESSAGE)}


def run_logs(path: Path, sensor_to_bit: float) -> tuple[DepthLog, ToolHealth] | None:
    """
    Return the logs and the health of the tool of a run; None if it has neither a journal of logs nor recorded samples.

    Parameters
    ----------
    path : Path
        Folder of a run, a survey list in it, or a recording.
    sensor_to_bit : float
        Distance from the sonde to the bit, m, for a folder.
    """
    folders = [path.parent] if path.is_file() else [path, path / "surveys", *path.glob("*/surveys")]
    journal = next((folder / NAME for folder in folders if (folder / NAME).is_file()), None)
    if journal is not None:
        limits, remark = limits_of_run(journal.with_name(FILE))
        log, health = DepthLog(sensor_to_bit), HealthLedger(limits)
        restore(lines_of(journal), log, health)
        return log, dataclasses.replace(health.health(), remarks=(remark,) if remark else ())
    if not path.is_dir() or not any(path.glob("*.mcap")):
        return None
    with Bag(path) as bag:
        namespace = namespace_with(bag, _PLAYED)
        if namespace is None:
            return None
        player = Player(bag, namespace, only=frozenset(_PLAYED))
        player.seek(player.length_s)
        return player.well.book.logs, player.state().tool_health
