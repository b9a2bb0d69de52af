# SPDX-License-Identifier: Apache-2.0
"""
Make SIGINT and SIGTERM end a node, whatever its main thread is doing.

Python runs a signal handler in the main thread, between two instructions. A node that compiles its filters, waits in
the middleware or hangs would not notice the signal. A separate thread reads the signal instead, from the file to which
the interpreter's own handler writes it at once (`signal.set_wakeup_fd`).
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

_LOOK_PERIOD = 0.2  # time between two checks whether the process is late, s
_LOCK_PATIENCE = 1.0  # extra time for a thread that holds the interpreter's lock, s
_START_PATIENCE = 2.0  # time for a node that is still starting when the signal arrives, s
_NUMBERS = (signal.SIGINT, signal.SIGTERM)


class StopSignals:
    """
    Calls a function from a thread when SIGINT or SIGTERM arrives, until the end of the process.

    If the process is still starting two seconds after the signal, it has nothing to shut down and ends with status 0.

    Parameters
    ----------
    stop : callable
        Called at each signal; must be thread-safe.
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
        """Declare that the process has started; from now on a signal shuts it down in order."""
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
    End this process with status 1, and its stacks on standard error, if it is still running after a time.

    seconds does not include the time in which the main thread waits for a processor.
    """
    allowed = StopTime(seconds, STOP_LIMIT)
    _end_without_lock(allowed)  # in case the interpreter's lock is held before the thread below starts
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
    """End this process by a timer that needs no lock, in case native code holds the interpreter's lock."""
    faulthandler.dump_traceback_later(max(allowed.left(), 0.0) + _LOCK_PATIENCE, exit=True)


def leave_background_threads(status: int) -> None:
    """
    End this process at once if background threads are still working.

    The node that needed the results of these threads has ended, and a normal end of Python would wait for the threads.
    The node has already waited for work that must finish (recordings, exports).
    """
    if any(thread is not threading.main_thread() and not thread.daemon for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def ignore() -> None:
    """Ignore SIGINT and SIGTERM from now on: the process is ending and Python's shutdown cannot handle them."""
    for number in _NUMBERS:
        signal.signal(number, signal.SIG_IGN)
