# SPDX-License-Identifier: Apache-2.0
"""
Limits of the subscriptions of the OPC UA server that asyncua does not set itself.

A client on this machine needs no certificate, and each of its monitored items costs memory and, at every new value,
time in the process of the surface node. asyncua limits the number of subscriptions, but not of their items. It accepts
any publishing interval, however short, and lets a later request lengthen a queue beyond the limit of the server.
"""

from __future__ import annotations

import math
from typing import Any

# Largest number of monitored items on the server; a client that watches every variable has about a hundred
MOST_ITEMS = 4000
LONGEST_QUEUE = 100  # largest number of values in the queue of one item; the variables change once per second
SHORTEST_MS, LONGEST_MS = 100.0, 3_600_000.0  # limits of the publishing interval, ms


class SubscriptionLimits:
    """
    Limiter in front of the subscription service of a server.

    Parameters
    ----------
    ua : module
        `asyncua.ua`.
    service : asyncua.server.subscription_service.SubscriptionService
        Service whose methods that answer requests are replaced by the methods of this object.
    """

    def __init__(self, ua: Any, service: Any) -> None:
        self._ua, self._service = ua, service
        self._items: dict[int, set[int]] = {}
        self.refused = 0
        self._create_subscription = service.create_subscription
        self._create, self._modify, self._delete = (
            service.create_monitored_items,
            service.modify_monitored_items,
            service.delete_monitored_items,
        )
        service.create_subscription = self.create_subscription
        service.create_monitored_items = self.create_monitored_items
        service.modify_monitored_items = self.modify_monitored_items
        service.delete_monitored_items = self.delete_monitored_items

    @property
    def items(self) -> int:
        """Number of monitored items on the server; may be read from any thread."""
        return sum(len(made) for number, made in list(self._items.items()) if number in self._service.subscriptions)

    async def create_subscription(self, params: Any, *args: Any, **named: Any) -> Any:
        """Create a subscription with its publishing interval limited; an infinite one becomes the longest allowed."""
        asked = params.RequestedPublishingInterval
        params.RequestedPublishingInterval = (
            min(max(asked, SHORTEST_MS), LONGEST_MS) if math.isfinite(asked) else LONGEST_MS
        )
        return await self._create_subscription(params, *args, **named)

    async def create_monitored_items(self, params: Any) -> list[Any]:
        """Create as many of the items as the limit allows; further items get BadTooManyMonitoredItems."""
        for ended in self._items.keys() - self._service.subscriptions.keys():
            del self._items[ended]
        asked = params.ItemsToCreate
        room = max(0, MOST_ITEMS - self.items)
        params.ItemsToCreate = asked[:room]
        results = list(await self._create(params))
        made = self._items.setdefault(params.SubscriptionId, set())
        made |= {result.MonitoredItemId for result in results if result.StatusCode.is_good()}
        for _ in asked[room:]:
            refusal = self._ua.MonitoredItemCreateResult()
            refusal.StatusCode = self._ua.StatusCode(self._ua.StatusCodes.BadTooManyMonitoredItems)
            results.append(refusal)
            self.refused += 1
        return results

    def modify_monitored_items(self, params: Any) -> Any:
        """Change monitored items, with queues limited to LONGEST_QUEUE."""
        for item in params.ItemsToModify:
            wanted = item.RequestedParameters
            wanted.QueueSize = min(wanted.QueueSize or LONGEST_QUEUE, LONGEST_QUEUE)
        return self._modify(params)

    def delete_monitored_items(self, params: Any) -> Any:
        """Delete monitored items, and remove them from the count."""
        results = self._delete(params)
        self._items.get(params.SubscriptionId, set()).difference_update(params.MonitoredItemIds)
        return results
