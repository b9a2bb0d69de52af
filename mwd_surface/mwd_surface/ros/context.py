# SPDX-License-Identifier: Apache-2.0
"""Objects that all parts of the surface node share."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import queue
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from mwd_sensors.core.wire import NANOSECONDS
from mwd_sensors.ros.lifecycle_node import GraphNode
from mwd_surface.live.alarms import AlarmLog
from mwd_surface.live.live_state import LiveState
from mwd_surface.live.well_context import WellContext
from mwd_surface.live.well_state import WellState

# Work in threads.

Answer = tuple[bool, str]  #: whether a request was carried out, and a message

_Job = tuple[concurrent.futures.Future[Any], Callable[[Any], None]]
_TIMEOUT_S = 12.0  # longest wait of another thread for the answer of the node, s


class BackgroundWorker:
    """Runner of slow jobs, one at a time in a background thread; their callbacks run in the node's thread."""

    def __init__(self) -> None:
        self._executor = concurrent.futures.ThreadPoolExecutor(1, "surface-worker")
        self._jobs: list[_Job] = []
        self._writing: set[concurrent.futures.Future[Any]] = set()

    def submit(
        self,
        job: Callable[[], Any],
        callback: Callable[[concurrent.futures.Future[Any]], None],
        *,
        writes: bool = False,
    ) -> None:
        """
        Run `job` in the background; then `callback` is called with the future of the job in the node's thread.

        writes: whether the job writes a file that a user requested; `close` waits for such jobs.
        """
        future = self._executor.submit(job)
        self._jobs.append((future, callback))
        if writes:
            self._writing.add(future)
            future.add_done_callback(self._writing.discard)

    def run_callbacks(self) -> None:
        """
        Call the callbacks of finished jobs; called by the node's timer.

        If a callback raises, the remaining callbacks run in the next call, because a client waits for each of them.
        """
        finished: list[_Job] = []
        running: list[_Job] = []
        for entry in self._jobs:
            # Call `done` only once per job, so that a job that finishes in between is not lost.
            (finished if entry[0].done() else running).append(entry)
        self._jobs = running
        while finished:
            job, callback = finished.pop(0)
            try:
                callback(job)
            except Exception:
                self._jobs = [*finished, *self._jobs]
                raise

    def close(self) -> None:
        """Start no further jobs, and wait for jobs that write a file; results of other jobs are dropped."""
        self._executor.shutdown(wait=False, cancel_futures=True)
        concurrent.futures.wait(set(self._writing))


class RequestQueue:
    """
    Requests from the threads of page and rig interfaces, carried out in the node's thread.

    Parameters
    ----------
    handler : callable
        `handler(name, arguments) -> (success, message)`, or a future of it; called by `run_requests`.
    """

    def __init__(self, handler: Callable[[str, dict[str, Any]], Answer | concurrent.futures.Future[Answer]]) -> None:
        self._handler = handler
        self._queue: queue.SimpleQueue[tuple[str, dict[str, Any], concurrent.futures.Future[Answer]]] = (
            queue.SimpleQueue()
        )

    def call(self, name: str, arguments: dict[str, Any]) -> Answer:
        """
        Send a request from another thread; return its answer.

        After `_TIMEOUT_S` without an answer, False and a message are returned; the request may still be carried out.
        """
        answer: concurrent.futures.Future[Answer] = concurrent.futures.Future()
        self._queue.put((name, arguments, answer))
        try:
            return answer.result(_TIMEOUT_S)
        except TimeoutError:
            return False, "the surface node did not answer; try again"

    def run_requests(self) -> None:
        """Carry out the waiting requests; called by the node's timer. If the handler raises, the request fails."""
        while not self._queue.empty():
            name, arguments, answer = self._queue.get()
            try:
                result = self._handler(name, arguments)
            except Exception as error:  # noqa: BLE001  (the caller gets the error; the node continues)
                answer.set_result((False, f"{name} failed inside the node: {error!r}"))
                continue
            if isinstance(result, concurrent.futures.Future):
                result.add_done_callback(partial(_copy_result, answer))
            else:
                answer.set_result(result)


def _copy_result(answer: concurrent.futures.Future[Answer], finished: concurrent.futures.Future[Answer]) -> None:
    error = finished.exception()
    answer.set_result(finished.result() if error is None else (False, f"failed inside the node: {error!r}"))


_JUMP_NS = NANOSECONDS // 10  # a larger change against the steady clock means that the wall clock was set, not slewed


class SteadyTime:
    """Time since the epoch without steps: the wall clock at the start, continued by the steady clock."""

    def __init__(self) -> None:
        self._ahead_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Return the present time, ns since the epoch."""
        return time.monotonic_ns() + self._ahead_ns

    def of(self, wall_ns: int) -> int:
        """Convert a recent reading of the wall clock, ns, to this time, ns."""
        return wall_ns + self._shift_ns()

    def wall_of(self, steady_ns: int) -> int:
        """Convert a recent value of this time, ns, to the reading of the wall clock at that moment, ns."""
        return steady_ns - self._shift_ns()

    def _shift_ns(self) -> int:
        shift = self.now_ns() - time.time_ns()
        return shift if abs(shift) > _JUMP_NS else 0


@dataclasses.dataclass(frozen=True)
class SurfaceContext:
    """Surface node, and the objects that its parts share."""

    node: GraphNode[Any]  #: node that creates topics and services, and logs
    folder: Path  #: folder of the well: recordings, survey list and exports
    well: WellContext  #: clock, live state and alarm log of the well
    worker: BackgroundWorker  #: worker that runs slow work in another thread
    requests: RequestQueue  #: queue of requests of page and rig interfaces, which run in the node's thread

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
