# SPDX-License-Identifier: Apache-2.0
"""The alarm log of a well without a node."""

from mwd_surface.live.alarms import AlarmBook


class Alarms:
    """Raises and clears alarms in a book; `active` returns the active ones by their id."""

    def __init__(self):
        self.book = AlarmBook()

    def raise_alarm(self, alarm_id, severity, text, remedy=""):
        self.book.raise_alarm(alarm_id, severity, text, remedy, 1)

    def clear_alarm(self, alarm_id):
        self.book.clear(alarm_id, 2)

    def set_alarms(self, prefix, causes):
        self.book.sync(prefix, causes, 3)

    def active(self):
        return {alarm.id: alarm for alarm in self.book.alarms() if alarm.active}
