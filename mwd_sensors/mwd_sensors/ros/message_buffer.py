"""
Messages that wait until they are taken, and rows that leave together: what streams at a kilohertz want.

A callback per message wakes the process, the executor and Python for each. What a node handles in blocks anyway it
lets wait in the reader's own queue and takes with one call, in the order and with the times of arrival.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mwd_sensors.core import wire
from mwd_sensors.core.arrays import Samples

_MOST = 10_000  # messages of one take; a writer faster than the reader must not hold it for good


class Arrival(NamedTuple):
    """A serialised message and when the middleware received it, ns since the epoch."""

    data: bytes
    received_ns: int


class Inbox:
    """
    Takes what waits on a subscription that the executor leaves alone.

    Parameters
    ----------
    subscription : rclpy.subscription.Subscription
        Of serialised messages (``raw=True``).
    """

    def __init__(self, subscription: Any) -> None:
        self.subscription = subscription

    def take(self) -> list[Arrival]:
        """Everything that waits, oldest first."""
        taken: list[Arrival] = []
        reader, kind = self.subscription.handle, self.subscription.msg_type
        with reader:
            while len(taken) < _MOST and (found := reader.take_message(kind, True)) is not None:
                taken.append(Arrival(found[0], found[1]["received_timestamp"]))
        return taken


def decoded(layout: wire.Layout, messages: Sequence[bytes]) -> tuple[Samples, list[wire.WireError]]:
    """Samples of the messages that are of that layout, in their order, and what was wrong with the others."""
    if not messages:
        return layout.empty(0), []
    size = len(messages[0])
    try:
        if all(len(message) == size for message in messages):
            rows = np.frombuffer(b"".join(messages), dtype=np.uint8).reshape(len(messages), size)
            return layout.decode(rows), []
    except wire.WireError:
        pass
    parts, errors = [layout.empty(0)], []
    for message in messages:
        try:
            parts.append(layout.decode(message))
        except wire.WireError as error:
            errors.append(error)
    return np.concatenate(parts), errors


def publish_rows(publisher: Any, rows: wire.Rows) -> None:
    """Publish rows of one layout as messages, in their order; nothing while the publisher is silent or unheard."""
    if not len(rows) or not publisher.is_activated:
        return
    size, joined, writer = rows.shape[1], rows.tobytes(), publisher.handle
    with writer:
        for start in range(0, len(joined), size):
            writer.publish_raw(joined[start : start + size])
