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

from mwd_sensors.core.stop_time import STOP_LIMIT, StopTime

_LOOK_PERIOD = 0.2  # s
_LOCK_PATIENCE = 1.0  # s; that a thread which holds the interpreter's lock has beyond the limit
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

    seconds: without the time in which the main thread waits for a processor.
    """
    allowed = StopTime(seconds, STOP_LIMIT)
    _end_without_lock(allowed)  # what comes next may hold the interpreter's lock before the thread has begun
    threading.Thread(target=_end_when_late, args=(allowed,), name="stop limit", daemon=True).start()


def _end_when_late(allowed: StopTime) -> None:
    while (left := allowed.left()) > 0.0:
        _end_without_lock(allowed)
        time.sleep(min(_LOOK_PERIOD, left))
    sys.stderr.write(f"still running {allowed.elapsed():.1f} s after the request to stop; what its threads do:\n")
    sys.stderr.flush()
    faulthandler.dump_traceback(all_threads=True)
    os._exit(1)


def _end_without_lock(allowed: StopTime) -> None:
    """End this process by a timer that needs no lock, for where native code holds the interpreter's."""
    faulthandler.dump_traceback_later(max(allowed.left(), 0.0) + _LOCK_PATIENCE, exit=True)


def leave_background_threads(status: int) -> None:
    """
    End this process at once if threads still work in the background: the node that wanted their results is gone.

    Python's own end would wait for them. What must become whole (a recording, an export), the node has waited for.
    """
    if any(thread is not threading.main_thread() and not thread.daemon for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def ignore() -> None:
    """Let SIGINT and SIGTERM pass from now on: the process is ending, and Python's own end would not bear them."""
    for number in _NUMBERS:
        signal.signal(number, signal.SIG_IGN)
