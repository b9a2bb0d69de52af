# SPDX-License-Identifier: Apache-2.0
"""
SIGINT and SIGTERM end a node whatever its main thread does.

Python runs a signal handler in the main thread, and only between two of its instructions: a node that compiles its
filters, waits in the middleware or hangs does not hear it. A thread hears it instead, through the file that the
interpreter's own handler writes to at once (`signal.set_wakeup_fd`).
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import threading
import time
from collections.abc import Callable

STOP_PATIENCE = 15.0
"""Longest time from the request to stop to the end of the process, s, apart from the time it waits for a processor."""
STOP_LIMIT = 60.0
"""Longest time whatever it waits for, s: whoever started the process waits longer than that before SIGKILL."""
_LOOK_PERIOD = 0.2  # s
_START_PATIENCE = 2.0  # s; from a signal until a node that is still starting is given up
_NUMBERS = (signal.SIGINT, signal.SIGTERM)


class StopSignals:
    """
    Calls a function when SIGINT or SIGTERM comes, from a thread; in force from its making to the end of the process.

    A process that is still starting two seconds later has nothing to put in order yet and ends at once, with status 0.

    Parameters
    ----------
    stop : callable
        Called at each signal; thread-safe.
    """

    def __init__(self, stop: Callable[[], None]) -> None:
        self._stop = stop
        self._started = threading.Event()
        reader, writer = os.pipe()
        os.set_blocking(writer, False)
        for number in _NUMBERS:
            signal.signal(number, lambda *_: None)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        threading.Thread(target=self._listen, args=(reader,), name="signals", daemon=True).start()

    def started(self) -> None:
        """Say that the process has started: from now on it ends in order."""
        self._started.set()

    def _listen(self, reader: int) -> None:
        while number := os.read(reader, 1):
            if number[0] not in _NUMBERS:
                continue
            self._stop()
            if not self._started.wait(_START_PATIENCE):
                sys.stderr.write("stopped while it was starting\n")
                sys.stderr.flush()
                os._exit(0)


def end_within(seconds: float) -> None:
    """
    End this process with status 1, and the stacks of its threads on standard error, unless it ends before.

    The time in which the main thread waits for a processor does not count, where the system tells it: a node that still
    works on a busy machine does not hang.
    """
    # Needs neither the main thread nor the interpreter's lock.
    faulthandler.dump_traceback_later(seconds, exit=True)
    threading.Thread(target=_allow_for_waiting, args=(seconds,), name="stop limit", daemon=True).start()


def _allow_for_waiting(seconds: float) -> None:
    try:
        schedule = os.open("/proc/self/schedstat", os.O_RDONLY)  # of the main thread
    except OSError:
        return
    began, waited = time.monotonic(), _waited_for_processor(schedule)
    while True:
        time.sleep(_LOOK_PERIOD)
        allowed = min(seconds + _waited_for_processor(schedule) - waited, STOP_LIMIT)
        left = began + allowed - time.monotonic()
        faulthandler.dump_traceback_later(max(left, 1e-3), exit=True)


def _waited_for_processor(schedule: int) -> float:
    """Time that a thread has waited for a processor so far, s: the second number of its schedstat, in ns."""
    return int(os.pread(schedule, 100, 0).split()[1]) * 1e-9


def ignore() -> None:
    """Let SIGINT and SIGTERM pass from now on: the process is ending, and Python's own end would not bear them."""
    for number in _NUMBERS:
        signal.signal(number, signal.SIG_IGN)
