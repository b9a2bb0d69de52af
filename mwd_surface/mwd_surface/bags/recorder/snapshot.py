# SPDX-License-Identifier: Apache-2.0
"""The last seconds of all received messages, kept in bounded memory for a snapshot."""

from __future__ import annotations

import time
from collections import deque

from mwd_surface.bags import bag_metadata
from mwd_surface.bags.bag_writer import BagWriter
from mwd_surface.bags.recorder.message_queue import Item


class SnapshotRing:
    """Messages of the last `seconds` seconds, limited to `most` bytes."""

    def __init__(self, seconds: float, most: int) -> None:
        self._seconds, self._most = seconds, most
        self._items: deque[tuple[float, Item]] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._items)

    def keep(self, item: Item) -> None:
        """Add a message and remove the oldest ones beyond the limits."""
        now = time.monotonic()
        self._items.append((now, item))
        self._bytes += item.size
        while self._items and (now - self._items[0][0] > self._seconds or self._bytes > self._most):
            self._bytes -= self._items.popleft()[1].size

    def write(self, writer: BagWriter) -> None:
        """Write the kept messages into a bag, oldest first."""
        for _, (topic, type_name, data, log_ns, publish_ns, qos, type_hash) in self._items:
            try:
                profiles = bag_metadata.parse_qos(qos)
            except ValueError:
                profiles = []
            channel = writer.topic(topic, type_name, profiles, type_hash, need_definition=False)
            writer.write(channel, data, max(log_ns, 0), publish_ns)
