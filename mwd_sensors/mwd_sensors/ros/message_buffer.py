# SPDX-License-Identifier: Apache-2.0
"""
Buffers for topics at kilohertz rates, from which many messages are read at a time.

A callback per message would wake the process, the executor and Python for each message. A node that works in blocks
leaves the messages in the queue of the middleware's reader and reads all of them with one call, in order of arrival.
"""

from __future__ import annotations

from typing import Any, NamedTuple

# Largest number of messages that one call of `take` returns: a writer that is faster than the reader must not block the
# node.
_MAX_TAKEN = 10_000


class ReceivedMessage(NamedTuple):
    """A serialised message and the time at which the middleware received it, ns since 1970."""

    data: bytes
    received_ns: int


class MessageBuffer:
    """
    Reads the messages in the queue of a subscription that the executor does not serve.

    Parameters
    ----------
    subscription : rclpy.subscription.Subscription
        Subscription to serialised messages (``raw=True``).
    """

    def __init__(self, subscription: Any) -> None:
        self.subscription = subscription

    def drain(self) -> list[ReceivedMessage]:
        """Remove and return the waiting messages, oldest first, at most `_MAX_TAKEN`."""
        taken: list[ReceivedMessage] = []
        reader, msg_type = self.subscription.handle, self.subscription.msg_type
        with reader:
            while len(taken) < _MAX_TAKEN and (found := reader.take_message(msg_type, True)) is not None:
                taken.append(ReceivedMessage(found[0], found[1]["received_timestamp"]))
        return taken
