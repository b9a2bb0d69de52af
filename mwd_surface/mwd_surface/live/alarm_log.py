# SPDX-License-Identifier: Apache-2.0
"""Alarms and events of one well: raised by its parts, kept in one book, told to whoever writes a log."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mwd_sensors.core.foreign_text import printable
from mwd_surface.live.alarms import AlarmBook, Severity
from mwd_surface.live.well_clock import WellClock


def _untold(_text: str, _severity: Severity) -> None:
    """Tell nobody."""


class AlarmLog:
    """
    Alarms and events of one well.

    Parameters
    ----------
    clock : WellClock
    tell : callable, optional
        `tell(text, severity)`, called with each event and alarm.
    stamp : callable, optional
        Time with which alarms and events are stamped, ns; by default that of the clock. A graph with a time of its
        own, such as a simulated one, has its own stamps.

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
        """Time for stamps, ns."""
        return self._stamp()

    def log_event(self, source: str, text: str, severity: Severity = Severity.INFO) -> None:
        """Log an event that is not an alarm."""
        self.book.note(source, text, self.now_ns(), severity)
        self._tell(printable(f"{source}: {text}"), Severity.INFO)

    def raise_alarm(self, alarm_id: str, severity: Severity, text: str, remedy: str = "") -> None:
        """Raise an alarm, or raise it again."""
        self.book.raise_alarm(alarm_id, severity, text, remedy, self.now_ns())
        self._tell(printable(f"{text}; {remedy}" if remedy else text), Severity.CRITICAL)

    def clear_alarm(self, alarm_id: str) -> None:
        """Clear an alarm whose cause has gone; without effect where it is not raised."""
        self.book.clear(alarm_id, self.now_ns())

    def set_alarms(self, prefix: str, causes: Mapping[str, tuple[int, str, str]]) -> None:
        """
        Set all alarms whose id starts with the prefix: raise those named, clear the others.

        causes: from id to severity, text and remedy.
        """
        self.book.sync(prefix, causes, self.now_ns())
