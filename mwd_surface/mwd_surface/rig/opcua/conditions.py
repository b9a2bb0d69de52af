# SPDX-License-Identifier: Apache-2.0
"""Alarms of the well as OPC UA conditions: events of AlarmConditionType, with ConditionRefresh (OPC 10000-9)."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any

from mwd_surface.live.alarms import Alarm, Severity
from mwd_surface.rig.opcua.data_value import moment

# Ranges of OPC 10000-5, 6.4.2: 1 to 333 low, 334 to 666 medium, 667 to 1000 high.
_SEVERITY: Mapping[int, int] = {Severity.INFO: 200, Severity.WARNING: 500, Severity.CRITICAL: 900}


class Conditions:
    """
    Sender of an event whenever an alarm is raised, changes, is acknowledged or ends.

    Parameters
    ----------
    ua : module
        `asyncua.ua`.
    server : asyncua.Server
    source : asyncua.Node
        Object of the well that is the source of the events.
    """

    def __init__(self, ua: Any, server: Any, source: Any) -> None:
        self._ua, self._server, self._source = ua, server, source
        self._shown: dict[str, Alarm] = {}
        # The event object is shared, so only one task may fill and send it at a time.
        self._sending = asyncio.Lock()

    async def open(self) -> None:
        """Make the well a source of events, and serve ConditionRefresh."""
        ua = self._ua
        await self._source.set_event_notifier([ua.EventNotifier.SubscribeToEvents])
        # The server is the root of all sources, so a client may also subscribe there.
        server = self._server.nodes.server
        await server.add_reference(self._source, ua.ObjectIds.HasEventSource, True, False)
        self._events = await self._server.get_event_generator(
            ua.ObjectIds.AlarmConditionType, emitting_node=self._source.nodeid
        )
        # Set the type, because asyncua knows the base type of UtcTime only by its node.
        self._events.event.data_types["ActiveState/TransitionTime"] = ua.VariantType.DateTime
        self._refresh = [
            await self._server.get_event_generator(kind)
            for kind in (ua.ObjectIds.RefreshStartEventType, ua.ObjectIds.RefreshEndEventType)
        ]
        refresh = self._server.get_node(ua.ObjectIds.ConditionType_ConditionRefresh)
        self._server.link_method(refresh, self._refresh_all)

    async def show(self, alarms: Sequence[Alarm]) -> None:
        """Send the alarms that changed since the last call."""
        now = {alarm.id: alarm for alarm in alarms}
        async with self._sending:
            await self._send_changes(now)

    async def _send_changes(self, now: Mapping[str, Alarm]) -> None:
        for alarm in sorted(now.values(), key=lambda a: a.last_ns):
            before = self._shown.get(alarm.id)
            # The count of a lasting cause grows each time it is seen; a new count alone sends no event.
            if before is None or _news(before) != _news(alarm):
                await self._send(alarm, retain=True)
        for gone in self._shown.keys() - now.keys():
            await self._send(self._shown[gone], retain=False)
        self._shown = dict(now)

    async def _refresh_all(self, _parent: Any, subscription: Any) -> list[Any]:
        """Send all alarms again to one subscription, between start and end events, for a client that connects late."""
        start, end = self._refresh
        async with self._sending:
            await start.trigger(subscription_id=subscription.Value)
            for alarm in self._shown.values():
                await self._send(alarm, retain=True, subscription=subscription.Value)
            await end.trigger(subscription_id=subscription.Value)
        return []

    async def _send(self, alarm: Alarm, *, retain: bool, subscription: int | None = None) -> None:
        ua, event, source = self._ua, self._events.event, self._source.nodeid
        active = alarm.active and retain
        acknowledged = alarm.acknowledged or not retain
        fields = {
            "NodeId": ua.NodeId(f"{source.Identifier}.alarm.{alarm.id}", source.NamespaceIndex),
            "ConditionName": alarm.id,
            "ConditionClassId": ua.NodeId(ua.ObjectIds.ProcessConditionClassType),
            "ConditionClassName": ua.LocalizedText("ProcessConditionClass"),
            "BranchId": ua.NodeId(),
            "Retain": retain,
            "Message": ua.LocalizedText(f"{alarm.text}; {alarm.remedy}" if alarm.remedy else alarm.text),
            "Severity": _SEVERITY[alarm.severity],
            "EnabledState": ua.LocalizedText("Enabled"),
            "EnabledState/Id": True,
            "ActiveState": ua.LocalizedText("Active" if active else "Inactive"),
            "ActiveState/Id": active,
            "ActiveState/TransitionTime": moment(alarm.raised_ns if active else alarm.last_ns),
            "AckedState": ua.LocalizedText("Acknowledged" if acknowledged else "Unacknowledged"),
            "AckedState/Id": acknowledged,
            "ClientUserId": alarm.acknowledged_by,
            "Quality": ua.StatusCode(ua.StatusCodes.Good),
        }
        for name, value in fields.items():
            setattr(event, name, value)
        await self._events.trigger(subscription_id=subscription)


def _news(alarm: Alarm) -> tuple[object, ...]:
    return alarm.text, alarm.severity, alarm.active, alarm.acknowledged
