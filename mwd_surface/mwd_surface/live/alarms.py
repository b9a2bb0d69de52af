# SPDX-License-Identifier: Apache-2.0
"""
Alarms and the log of events.

A critical alarm stays until its cause has ended and a person has acknowledged it. An alarm of lower priority ends with
its cause; the log keeps it (states of ISA-18.2).
"""

from __future__ import annotations

import dataclasses
import enum
from collections import deque
from collections.abc import Callable, Mapping
from typing import ClassVar

from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.message_record import MessageRecord

# Largest numbers of alarms and of events that are stored. At the limit, a new event replaces the oldest event, and a
# new alarm replaces the oldest alarm that is not active any more. If all stored alarms are active, the new alarm is not
# stored, but an event with its text is logged.
_MAX_ALARMS, _MAX_EVENTS = 200, 1000

Causes = dict[str, tuple[int, str, str]]  #: id of an alarm -> severity, text and remedy


class Severity(enum.IntEnum):
    """Severity of an alarm or event, with the numbers of mwd_msgs/Alarm."""

    INFO = 0
    WARNING = 1
    CRITICAL = 2


@dataclasses.dataclass(frozen=True, eq=False)
class Alarm(MessageRecord):
    """One alarm, with the fields of mwd_msgs/Alarm; `count` is the number of times that its cause has begun."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/Alarm"

    id: str
    severity: int
    text: str
    remedy: str
    raised_ns: int
    last_ns: int
    active: bool = True
    acknowledged: bool = False
    acknowledged_by: str = ""
    count: int = 1

    @property
    def severity_word(self) -> str:
        """Severity in a word."""
        return Severity(self.severity).name.lower()


@dataclasses.dataclass(frozen=True, eq=False)
class Event(MessageRecord):
    """One line of the log, with the fields of mwd_msgs/Event."""

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/Event"

    stamp_ns: int
    kind: str
    source: str  #: id of an alarm, or a word for the origin of the event, such as "survey"
    text: str
    severity: int = int(Severity.INFO)

    @property
    def severity_word(self) -> str:
        """Severity in a word."""
        return Severity(self.severity).name.lower()


def _untold(_text: str, _severity: Severity) -> None:
    """Ignore an event or alarm; the default of `AlarmLog`."""


class AlarmLog:
    """
    Alarms of one well by id, and events newest first.

    Parameters
    ----------
    now_ns : callable
        Returns the time with which alarms and events are stamped, ns since the epoch.
    tell : callable, optional
        `tell(text, severity)`, called with each event of `log_event`, and when an alarm begins or becomes more severe.
    """

    def __init__(self, now_ns: Callable[[], int], tell: Callable[[str, Severity], None] = _untold) -> None:
        self.now_ns, self._tell = now_ns, tell
        self._alarms: dict[str, Alarm] = {}
        self._events: deque[Event] = deque(maxlen=_MAX_EVENTS)
        #: Number that changes with every change of the alarms or events.
        self.version = 0
        #: Number of events logged so far.
        self.logged = 0

    def alarms(self) -> tuple[Alarm, ...]:
        """Return the active alarms, and the critical alarms that nobody has acknowledged yet, newest first."""
        return tuple(sorted(self._alarms.values(), key=lambda a: (a.raised_ns, a.id), reverse=True))

    def events(self) -> tuple[Event, ...]:
        """Return the events of the log, newest first."""
        return tuple(reversed(self._events))

    def events_after(self, logged: int) -> tuple[Event, ...]:
        """Return the events after the first `logged` events, oldest first; events no longer stored are left out."""
        return tuple(self._events)[-(self.logged - logged) :] if self.logged > logged else ()

    def log_event(self, source: str, text: str, severity: Severity = Severity.INFO) -> None:
        """Log an event that is not an alarm, such as a new survey, the start of a recording or a person's decision."""
        self._log("note", source, text, severity)
        self._tell(printable(f"{source}: {text}"), severity)

    def raise_alarm(self, alarm_id: str, severity: int, text: str, remedy: str = "") -> None:
        """
        Raise an alarm because its cause is present, or update the alarm if it is raised already.

        An alarm that comes back or becomes more severe must be acknowledged again; the count of an alarm that comes
        back rises by one.
        """
        # Escape hidden characters: texts from files and peers are shown on terminals, which obey control characters.
        text, remedy, now_ns = printable(text), printable(remedy), self.now_ns()
        old = self._alarms.get(alarm_id)
        if old is None or not old.active:
            count = old.count + 1 if old else 1
            alarm = Alarm(alarm_id, int(severity), text, remedy, now_ns, now_ns, count=count)
            if old or self._has_room(alarm):
                self._begin(alarm, "raised")
            return
        alarm = dataclasses.replace(old, severity=int(severity), text=text, remedy=remedy, last_ns=now_ns)
        if alarm.severity > old.severity:
            self._begin(dataclasses.replace(alarm, acknowledged=False, acknowledged_by=""), "worse")
            return
        if (alarm.severity, alarm.text, alarm.remedy) != (old.severity, old.text, old.remedy):
            self.version += 1
        self._alarms[alarm_id] = alarm

    def clear_alarm(self, alarm_id: str) -> None:
        """
        Clear an alarm whose cause has ended; no effect if the alarm is not active.

        An unacknowledged critical alarm stays, but is not active.
        """
        old = self._alarms.get(alarm_id)
        if old is None or not old.active:
            return
        self._store(dataclasses.replace(old, active=False, last_ns=self.now_ns()), "cleared", old.text)
        if old.acknowledged or old.severity < Severity.CRITICAL:
            del self._alarms[alarm_id]

    def set_alarms(self, prefix: str, causes: Mapping[str, tuple[int, str, str]]) -> None:
        """
        Raise the alarms in `causes`, and clear all other alarms whose id starts with the prefix.

        causes maps the id of an alarm, which starts with the prefix, to (severity, text, remedy).

        Raises
        ------
        ValueError
            An id does not start with the prefix.
        """
        for alarm_id, (severity, text, remedy) in causes.items():
            if not alarm_id.startswith(prefix):
                raise ValueError(f"causes: {alarm_id!r} does not start with {prefix!r}")
            self.raise_alarm(alarm_id, severity, text, remedy)
        for alarm_id in [k for k in self._alarms if k.startswith(prefix) and k not in causes]:
            self.clear_alarm(alarm_id)

    def acknowledge(self, alarm_id: str, operator_name: str) -> tuple[bool, str]:
        """
        Acknowledge an alarm for a person, or all alarms if the id is empty; return success and a sentence.

        Without the name of the person, or with an unknown id, nothing changes.
        """
        if not operator_name.strip():
            return False, "operator_name: must not be empty: the log says who acknowledged"
        operator_name = printable(operator_name)
        if alarm_id and alarm_id not in self._alarms:
            return False, f"there is no alarm {alarm_id!r}; there are {', '.join(self._alarms) or 'none'}"
        wanted = [k for k, a in self._alarms.items() if not a.acknowledged and alarm_id in (k, "")]
        if not wanted:
            return True, "there is nothing to acknowledge"
        for key in wanted:
            seen = dataclasses.replace(self._alarms[key], acknowledged=True, acknowledged_by=operator_name)
            self._store(seen, "acknowledged", f"{seen.text} (acknowledged by {operator_name})")
            if not seen.active:
                del self._alarms[key]
        return True, f"{operator_name} acknowledged {', '.join(wanted)}"

    def _begin(self, alarm: Alarm, kind: str) -> None:
        self._store(alarm, kind, alarm.text)
        self._tell(f"{alarm.text}; {alarm.remedy}" if alarm.remedy else alarm.text, Severity(alarm.severity))

    def _store(self, alarm: Alarm, kind: str, text: str) -> None:
        self._alarms[alarm.id] = alarm
        self._log(kind, alarm.id, text, alarm.severity)

    def _log(self, kind: str, source: str, text: str, severity: int) -> None:
        self._events.append(Event(self.now_ns(), kind, printable(source), printable(text), int(severity)))
        self.logged += 1
        self.version += 1

    def _has_room(self, alarm: Alarm) -> bool:
        """Return whether there is room for a new alarm; if there is none, drop the oldest inactive alarm first."""
        if len(self._alarms) < _MAX_ALARMS:
            return True
        gone = min((a for a in self._alarms.values() if not a.active), key=lambda a: a.raised_ns, default=None)
        if gone is None:
            text = f"not shown, {_MAX_ALARMS} alarms are active: {alarm.text}"
            self._log("note", alarm.id, text, Severity.INFO)
            return False
        del self._alarms[gone.id]
        return True
