# SPDX-License-Identifier: Apache-2.0
"""
Log of the libraries that serve network peers, bounded in length and rate.

asyncua and pymodbus log every malformed message with its bytes and a traceback. A peer that sends junk could fill the
log with any contents, and hide the other messages.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable

from mwd_sensors.core.foreign_text import printable

_MOST, _PERIOD_S = 10, 60.0  # largest number of lines in a period, and the period, s
_LONGEST = 200  # largest number of characters in a line


class LibraryLog(logging.Handler):
    """
    Handler that writes the first line of each record, at most ten lines a minute, and the number of omitted records.

    Parameters
    ----------
    write : callable
        Called with one line.
    clock : callable
        Steady time, s.
    """

    def __init__(
        self, write: Callable[[str], object] | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(logging.WARNING)
        self._write = write or (lambda line: sys.stderr.write(line + "\n"))
        self._clock = clock
        self._since = -_PERIOD_S
        self._lines = self._left_out = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record, or only count it if the period already has its largest number of lines."""
        now = self._clock()
        if now - self._since >= _PERIOD_S:
            if self._left_out:
                self._write(f"{record.name}: {self._left_out} more messages were left out")
            self._since, self._lines, self._left_out = now, 0, 0
        if self._lines >= _MOST:
            self._left_out += 1
            return
        self._lines += 1
        text = record.getMessage().strip().partition("\n")[0]
        error = record.exc_info[1] if record.exc_info else None
        kind = f" ({type(error).__name__})" if error is not None else ""
        self._write(printable(f"{record.name}: {text[:_LONGEST]}{kind}"))


def bound_log(library: str) -> None:
    """Limit length and rate of the log of a library; does nothing if the log is limited already."""
    logger = logging.getLogger(library)
    if not any(isinstance(handler, LibraryLog) for handler in logger.handlers):
        logger.addHandler(LibraryLog())
