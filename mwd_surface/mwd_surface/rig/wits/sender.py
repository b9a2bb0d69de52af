# SPDX-License-Identifier: Apache-2.0
"""
Schedule of WITS packets: surveys once when accepted, toolfaces as they come, other records by period.

All peers of an interface get the same bytes; a new peer first gets the last accepted survey and the toolface.
"""

from __future__ import annotations

import dataclasses

from mwd_sensors.core.settings import setting
from mwd_surface.rig.values import RigValues
from mwd_surface.rig.wits.format import KEEP_ALIVE, encode
from mwd_surface.rig.wits.records import Items, RecordWriter, Wits0Format


@dataclasses.dataclass(frozen=True)
class Wits0Schedule:
    """Sending intervals."""

    toolface_period: float = setting(
        4.0,
        "shortest time between toolfaces; a shorter time loads a slow serial line",
        unit="s",
        low=1.0,
        high=60.0,
        fixed=True,
    )
    record_period: float = setting(
        5.0,
        "time between records 8 and 9; a shorter time loads a slow serial line",
        unit="s",
        low=1.0,
        high=600.0,
        fixed=True,
    )
    keep_alive: float = setting(
        30.0,
        "time between keep-alive packets",
        unit="s",
        low=5.0,
        high=600.0,
        fixed=True,
    )
    stream_survey: bool = setting(
        False,
        "send the last accepted survey again with every record period; if false, send it only when it is accepted",
        fixed=True,
    )


class Wits0Sender:
    """Finder of the packets that are due, by a steady clock, s; it remembers what was sent and when."""

    def __init__(self, form: Wits0Format, schedule: Wits0Schedule) -> None:
        self.form, self.schedule = form, schedule
        self._writer = RecordWriter(form)
        self._sent_keys: set[tuple[str, int, int]] | None = None
        self._toolface_at = self._records_at = self._alive_at = -1e9
        self._toolface_stamp = 0

    def due(self, values: RigValues, now: float) -> list[bytes]:
        """Return the packets that are due for all peers, in order: surveys, toolface, records 8 and 9, keep-alive."""
        groups = self._surveys(values)
        toolface = values.toolface
        new = toolface.stamp_ns != self._toolface_stamp or not toolface.condition.usable
        if new and now - self._toolface_at >= self.schedule.toolface_period:
            items = self._writer.toolface(values)
            if items:
                groups.append(items)
                self._toolface_at, self._toolface_stamp = now, toolface.stamp_ns
        if now - self._records_at >= self.schedule.record_period:
            self._records_at = now
            if self.schedule.stream_survey and values.survey is not None:
                groups.append(self._writer.survey(values, values.survey))
            groups += [self._writer.formation(values), self._writer.mechanical(values)]
        packets = self._packets(groups)
        if now - self._alive_at >= self.schedule.keep_alive:
            self._alive_at = now
            packets.append(KEEP_ALIVE)
        return packets

    def greeting(self, values: RigValues) -> list[bytes]:
        """Return the packets for a new peer: the last accepted survey and the toolface in force."""
        survey = values.survey
        groups = [] if survey is None else [self._writer.survey(values, survey)]
        return self._packets([*groups, self._writer.toolface(values)])

    def _surveys(self, values: RigValues) -> list[Items]:
        if self._sent_keys is None:
            # Surveys accepted before the start are not sent as new; the greeting contains the last of them.
            self._sent_keys = {s.key for s in values.surveys}
            return []
        fresh = [s for s in values.surveys if s.key not in self._sent_keys]
        self._sent_keys = {s.key for s in values.surveys}
        return [self._writer.survey(values, s) for s in fresh]

    def _packets(self, groups: list[Items]) -> list[bytes]:
        groups = [items for items in groups if items]
        if self.form.mixed:
            groups = _merged(groups)
        return [encode(items, self.form.source) for items in groups]


def _merged(groups: list[Items]) -> list[Items]:
    """Merge records into packets so that no packet holds the same record twice."""
    merged: list[Items] = []
    inside: set[int] = set()
    for items in groups:
        record = items[0][0] // 100
        if merged and record not in inside:
            merged[-1] = merged[-1] + items
        else:
            merged.append(items)
            inside = set()
        inside.add(record)
    return merged
