# SPDX-License-Identifier: Apache-2.0
"""What every part of the surface node uses."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_surface.live.alarm_log import AlarmLog
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.well_context import WellContext
from mwd_surface.live.well_state import WellState
from mwd_surface.ros.worker import BackgroundWorker, RequestQueue

_JUMP_NS = NANOSECONDS // 10  # the clocks of a machine are set, not slewed, where they part by more


class SteadyTime:
    """Time since the epoch that nobody sets: the wall clock of its begin, carried on by the steady clock."""

    def __init__(self) -> None:
        self._ahead_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Return the time, ns."""
        return time.monotonic_ns() + self._ahead_ns

    def of(self, wall_ns: int) -> int:
        """Return the time of a moment just past, ns, that the wall clock had as `wall_ns`."""
        return wall_ns + self._shift_ns()

    def wall_of(self, steady_ns: int) -> int:
        """Return what the wall clock had at a moment just past, ns, given in this time."""
        return steady_ns - self._shift_ns()

    def _shift_ns(self) -> int:
        shift = self.now_ns() - time.time_ns()
        return shift if abs(shift) > _JUMP_NS else 0


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
    well : WellContext
        Clock, live state and alarm log of the well.
    worker : BackgroundWorker
        Runs slow work in another thread.
    requests : RequestQueue
        Requests of page and rig interfaces, carried out in the node's thread.
    """

    node: GraphNode[Any]
    folder: Path
    well: WellContext
    worker: BackgroundWorker
    requests: RequestQueue

    @property
    def live(self) -> LiveState:
        """The well as page and rig interfaces see it."""
        return self.well.live

    @property
    def alarm_log(self) -> AlarmLog:
        """Alarms and events."""
        return self.well.alarm_log

    @property
    def well_now(self) -> float:
        """Time of the live state, s; other than the steady clock of the machine, by which controllers are timed."""
        return self.well.clock.now

    def state(self) -> WellState:
        """Return what is known of the well."""
        return self.live.at(self.well_now)

    def now_ns(self) -> int:
        """Time of the graph, ns."""
        return int(self.node.get_clock().now().nanoseconds)
