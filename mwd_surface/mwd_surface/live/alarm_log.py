# SPDX-License-Identifier: Apache-2.0
"""Alarms and events of one well: kept in an `AlarmBook`, and in part passed on to the log of the process."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mwd_sensors.core.foreign_text import printable
from mwd_surface.live.alarms import AlarmBook, Severity
from mwd_surface.live.well_clock import WellClock


def _untold(_text: str, _severity: Severity) -> None:
    """Ignore an event or alarm; the default of `AlarmLog`."""


class AlarmLog:
    """
    Alarms and events of one well.

    Parameters
    ----------
    tell : callable, optional
        `tell(text, severity)`, called with each event and with each alarm of `raise_alarm`. Alarms of `set_alarms`
        are not passed on.
    stamp : callable, optional
        Returns the time with which alarms and events are stamped, ns; by default the time of `clock`. With simulated
        time, this is the simulated time.

    Attributes
    ----------
    book : AlarmBook
    """

    def __init__(
        self,
        clock: WellClock,
        tell: Callable[[str, Severity], None] = _untold,
        stamp: Callable[[], int] | None = None,
    ) -> None:
        self.book = AlarmBook()
        self._tell = tell
        self._stamp = stamp or (lambda: clock.now_ns)

    def now_ns(self) -> int:
        """Return the time with which alarms and events are stamped, ns."""
        return self._stamp()

    def log_event(self, source: str, text: str, severity: Severity = Severity.INFO) -> None:
        """Log an event that is not an alarm."""
        self.book.note(source, text, self.now_ns(), severity)
        self._tell(printable(f"{source}: {text}"), severity)

    def raise_alarm(self, alarm_id: str, severity: Severity, text: str, remedy: str = "") -> None:
        """Raise an alarm, or update it if it is raised already (`AlarmBook.raise_alarm`)."""
        self.book.raise_alarm(alarm_id, severity, text, remedy, self.now_ns())
        self._tell(printable(f"{text}; {remedy}" if remedy else text), severity)

    def clear_alarm(self, alarm_id: str) -> None:
        """Clear an alarm whose cause has ended; no effect if the alarm is not raised."""
        self.book.clear(alarm_id, self.now_ns())

    def set_alarms(self, prefix: str, causes: Mapping[str, tuple[int, str, str]]) -> None:
        """
        Set all alarms whose id starts with the prefix: raise the alarms in `causes`, clear all others.

        causes maps the id of an alarm to its severity, text and remedy.
        """
        self.book.sync(prefix, causes, self.now_ns())
