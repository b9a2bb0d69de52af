# SPDX-License-Identifier: Apache-2.0
"""Objects that all parts of the surface node share."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.well_context import WellContext
from mwd_surface.live.well_state import WellState
from mwd_surface.ros.worker import BackgroundWorker, RequestQueue

_JUMP_NS = NANOSECONDS // 10  # a larger change against the steady clock means that the wall clock was set, not slewed


class SteadyTime:
    """Time since the epoch without steps: the wall clock at the start, continued by the steady clock."""

    def __init__(self) -> None:
        self._ahead_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Return the present time, ns since the epoch."""
        return time.monotonic_ns() + self._ahead_ns

    def of(self, wall_ns: int) -> int:
        """Return this time, ns, for a recent reading of the wall clock, ns."""
        return wall_ns + self._shift_ns()

    def wall_of(self, steady_ns: int) -> int:
        """Return the reading of the wall clock, ns, for a recent value of this time, ns."""
        return steady_ns - self._shift_ns()

    def _shift_ns(self) -> int:
        shift = self.now_ns() - time.time_ns()
        return shift if abs(shift) > _JUMP_NS else 0


@dataclasses.dataclass(frozen=True)
class SurfaceContext:
    """
    Surface node, and the objects that its parts share.

    Attributes
    ----------
    node : GraphNode
        Node that creates topics and services, and logs.
    folder : Path
        Folder of the well: recordings, survey list and exports.
    well : WellContext
        Clock, live state and alarm log of the well.
    worker : BackgroundWorker
        Worker that runs slow work in another thread.
    requests : RequestQueue
        Queue of requests of page and rig interfaces, which run in the node's thread.
    """

    node: GraphNode[Any]
    folder: Path
    well: WellContext
    worker: BackgroundWorker
    requests: RequestQueue

    @property
    def live(self) -> LiveState:
        """State of the well for page and rig interfaces."""
        return self.well.live

    @property
    def alarm_log(self) -> AlarmLog:
        """Log of alarms and events."""
        return self.well.alarm_log

    @property
    def well_now(self) -> float:
        """Time of the live state, s. It differs from the steady clock of the machine, which times controllers."""
        return self.well.clock.now

    def state(self) -> WellState:
        """Return the state of the well."""
        return self.live.at(self.well_now)

    def now_ns(self) -> int:
        """Return the time of the ROS graph, ns; simulated time if the graph has it."""
        return int(self.node.get_clock().now().nanoseconds)
