# SPDX-License-Identifier: Apache-2.0
"""How long a process may take to end once it was asked to, counted alike by the process and by whoever started it."""

from __future__ import annotations

import time
from pathlib import Path

STOP_PATIENCE = 15.0
"""Longest time from the request to stop to the end of a node, s, apart from the time it waits for a processor."""
STOP_LIMIT = 60.0
"""Longest time including the time it waits for a processor, s."""


class StopTime:
    """
    Time that is left to a process that was asked to stop when this object was made.

    The time in which its main thread waits for a processor does not count, where the system tells it (Linux): a process
    that still works on a busy machine does not hang.

    Parameters
    ----------
    patience : float
        Longest time without waiting for a processor, s.
    limit : float
        Longest time with it, s.
    process : int or "self"
        Number of the process.
    """

    def __init__(self, patience: float, limit: float, process: int | str = "self") -> None:
        self._patience, self._limit = patience, limit
        self._schedule = Path(f"/proc/{process}/schedstat")  # of the main thread
        self._began, self._waited_before, self._waited = time.monotonic(), self._waited_for_processor(), 0.0

    def elapsed(self) -> float:
        """Time since the request, s."""
        return time.monotonic() - self._began

    def left(self) -> float:
        """Time until the process is late, s; negative once it is."""
        self._waited = max(self._waited, self._waited_for_processor() - self._waited_before)
        return min(self._patience + self._waited, self._limit) - self.elapsed()

    def _waited_for_processor(self) -> float:
        """Time that the main thread has waited for a processor so far, s; 0 where the system does not tell it."""
        try:
            return int(self._schedule.read_text().split()[1]) * 1e-9
        except OSError:
            return 0.0
