# SPDX-License-Identifier: Apache-2.0
"""What every part of the surface node uses."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_surface.live.live_state import LiveState
from mwd_surface.ros.alarm_log import AlarmLog
from mwd_surface.ros.worker import BackgroundWorker, RequestQueue


@dataclasses.dataclass(frozen=True)
class SurfaceContext:
    """
    The surface node and what its parts share.

    Attributes
    ----------
    node : GraphNode
        Creates topics and services, and logs.
    folder : Path
        Of the well: recordings, survey list and exports.
    live : LiveState
        The well as page and rig interfaces see it.
    alarm_log : AlarmLog
        Alarms and events.
    worker : BackgroundWorker
        Runs slow work in another thread.
    requests : RequestQueue
        Requests of page and rig interfaces, carried out in the node's thread.
    """

    node: GraphNode[Any]
    folder: Path
    live: LiveState
    alarm_log: AlarmLog
    worker: BackgroundWorker
    requests: RequestQueue

    def now_ns(self) -> int:
        """Time of the graph, ns."""
        return self.alarm_log.now_ns()
