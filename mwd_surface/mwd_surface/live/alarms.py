# SPDX-License-Identifier: Apache-2.0
"""
Alarms and the log of events.

A critical alarm stays until its cause has ended and a person has acknowledged it. An alarm of lower priority ends with
its cause; the log keeps it (states of ISA-18.2).

No clock is read here: every call takes the time for messages and logs, ns since the epoch.
"""

from __future__ import annotations

import dataclasses
import enum
from collections import deque
from collections.abc import Mapping
from typing import ClassVar

from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.message_record import MessageRecord


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
    """
    One line of the log, with the fields of mwd_msgs/Event.

    source: id of an alarm, or a word for the origin of the event, such as "survey".
    """

    MESSAGE: ClassVar[str] = "mwd_msgs/msg/Event"

    stamp_ns: int
    kind: str
    source: str
    text: str
    severity: int = int(Severity.INFO)

    @property
    def severity_word(self) -> str:
        """Severity in a word."""
        return Severity(self.severity).name.lower()


class AlarmBook:
    """
    Alarms by id, and events newest first.

    Parameters
    ----------
    max_alarms, max_events : int
        Largest number of alarms and of events. A further event replaces the oldest event. A further alarm replaces the
        oldest alarm that is no longer active; if all are active, the new alarm is refused and an event is logged.
    """

    def __init__(self, max_alarms: int = 200, max_events: int = 1000) -> None:
        self._alarms: dict[str, Alarm] = {}
        self._events: deque[Event] = deque(maxlen=max_events)
        self._max_alarms = max_alarms
        self.version = 0
        #: Number of events logged so far.
        self.logged = 0

    def alarms(self) -> tuple[Alarm, ...]:
        """Return the active alarms, and the critical alarms that nobody has acknowledged yet, newest first."""
        return tuple(sorted(self._alarms.values(), key=lambda a: (a.raised_ns, a.id), reverse=True))

    def events(self) -> tuple[Event, ...]:
        """Return the events of the log, newest first."""
        return tuple(reversed(self._events))

    def raise_alarm(
        self, alarm_id: str, severity: Severity | int, text: str, remedy: str, stamp_ns: int
    ) -> tuple[Alarm, bool]:
        """
        Raise an alarm because its cause is present, or update the alarm if it is raised already.

        Returns the alarm, and whether it is new, has come back or has become more severe. An alarm that comes back or
        becomes more severe must be acknowledged again; the count of an alarm that comes back rises by one. A new alarm
        for which there is no room is returned with False, and is not kept.

        Raises
        ------
        ValueError
            The id is empty or the severity unknown.
        """
        if not alarm_id:
            raise ValueError("alarm_id: must not be empty")
        # Escape hidden characters: texts from files and peers are shown on terminals, which obey control characters.
        text, remedy = printable(text), printable(remedy)
        severity = int(Severity(severity))
        old = self._alarms.get(alarm_id)
        if old is None:
            alarm = Alarm(alarm_id, severity, text, remedy, stamp_ns, stamp_ns)
            if not self._make_room(alarm):
                return alarm, False
            return self._store(alarm, "raised", text, stamp_ns), True
        if not old.active:
            again = Alarm(alarm_id, severity, text, remedy, stamp_ns, stamp_ns, count=old.count + 1)
            return self._store(again, "raised", text, stamp_ns), True
        worse = severity > old.severity
        alarm = dataclasses.replace(
            old,
            severity=severity,
            text=text,
            remedy=remedy,
            last_ns=stamp_ns,
            acknowledged=old.acknowledged and not worse,
            acknowledged_by="" if worse else old.acknowledged_by,
        )
        if worse:
            return self._store(alarm, "worse", text, stamp_ns), True
        if (alarm.severity, alarm.text, alarm.remedy) != (old.severity, old.text, old.remedy):
            self.version += 1
        self._alarms[alarm_id] = alarm
        return alarm, False

    def clear(self, alarm_id: str, stamp_ns: int) -> bool:
        """Clear an alarm; return whether it was active. An unacknowledged critical alarm stays, but is not active."""
        old = self._alarms.get(alarm_id)
        if old is None or not old.active:
            return False
        self._store(dataclasses.replace(old, active=False, last_ns=stamp_ns), "cleared", old.text, stamp_ns)
        if old.acknowledged or old.severity < Severity.CRITICAL:
            del self._alarms[alarm_id]
        return True

    def sync(self, prefix: str, causes: Mapping[str, tuple[int, str, str]], stamp_ns: int) -> None:
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
            self.raise_alarm(alarm_id, severity, text, remedy, stamp_ns)
        for alarm_id in [k for k in self._alarms if k.startswith(prefix) and k not in causes]:
            self.clear(alarm_id, stamp_ns)

    def acknowledge(self, alarm_id: str, operator_name: str, stamp_ns: int) -> tuple[bool, str]:
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
            self._store(seen, "acknowledged", f"{seen.text} (acknowledged by {operator_name})", stamp_ns)
            if not seen.active:
                del self._alarms[key]
        return True, f"{operator_name} acknowledged {', '.join(wanted)}"

    def note(self, source: str, text: str, stamp_ns: int, severity: Severity | int = Severity.INFO) -> Event:
        """Log an event that is not an alarm, such as a new survey, the start of a recording or a person's decision."""
        event = Event(stamp_ns, "note", source, text, int(Severity(severity)))
        self._log(event)
        self.version += 1
        return event

    def _store(self, alarm: Alarm, kind: str, text: str, stamp_ns: int) -> Alarm:
        self._alarms[alarm.id] = alarm
        self._log(Event(stamp_ns, kind, alarm.id, text, alarm.severity))
        self.version += 1
        return alarm

    def events_after(self, logged: int) -> tuple[Event, ...]:
        """Return the events after the first `logged` events, oldest first; events no longer stored are left out."""
        return tuple(self._events)[-(self.logged - logged) :] if self.logged > logged else ()

    def _log(self, event: Event) -> None:
        self._events.append(dataclasses.replace(event, text=printable(event.text), source=printable(event.source)))
        self.logged += 1

    def _make_room(self, alarm: Alarm) -> bool:
        if len(self._alarms) < self._max_alarms:
            return True
        gone = min((a for a in self._alarms.values() if not a.active), key=lambda a: a.raised_ns, default=None)
        if gone is None:
            self.note(alarm.id, f"not shown, {self._max_alarms} alarms are active: {alarm.text}", alarm.raised_ns)
            return False
        del self._alarms[gone.id]
        return True
