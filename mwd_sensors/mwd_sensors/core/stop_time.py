# SPDX-License-Identifier: Apache-2.0
"""Time limits for a process to end after it was asked to stop, used by the process itself and by its supervisor."""

from __future__ import annotations

import time
from pathlib import Path

STOP_PATIENCE = 15.0
"""Longest time from the request to stop to the end of a node, s, not counting time spent waiting for a processor."""
STOP_LIMIT = 60.0
"""Longest time from the request to stop to the end of a node, s, counting all time."""


class StopTime:
    """
    Time left to a process that is asked to stop; the clock starts when this object is made.

    Time in which the main thread waits for a processor does not count, if the system reports it (Linux): a process that
    works slowly on a busy machine is not stuck.

    Parameters
    ----------
    patience : float
        Longest time, s, not counting time spent waiting for a processor.
    limit : float
        Longest time, s, counting all time.
    process : int or "self"
        Number (pid) of the process.
    """

    def __init__(self, patience: float, limit: float, process: int | str = "self") -> None:
        self._patience, self._limit = patience, limit
        self._schedule = Path(f"/proc/{process}/schedstat")  # scheduler statistics of the main thread
        self._began, self._waited_before, self._waited = time.monotonic(), self._waited_for_processor(), 0.0

    def elapsed(self) -> float:
        """Return the time since the request, s."""
        return time.monotonic() - self._began

    def left(self) -> float:
        """Return the time until the process is late, s; negative once it is late."""
        self._waited = max(self._waited, self._waited_for_processor() - self._waited_before)
        return min(self._patience + self._waited, self._limit) - self.elapsed()

    def _waited_for_processor(self) -> float:
        """Return the time that the main thread has waited for a processor, s; 0 if the system does not report it."""
        try:
            return int(self._schedule.read_text().split()[1]) * 1e-9
        except OSError:
            return 0.0
