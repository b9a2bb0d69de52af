# SPDX-License-Identifier: Apache-2.0
"""
Subscriptions for streams of a kilohertz: messages are taken many at a time.

A callback per message wakes the process, the executor and Python for each message. A node that works in blocks lets the
messages wait in the queue of the middleware's reader and takes all of them with one call, in order of arrival.
"""

from __future__ import annotations

from typing import Any, NamedTuple

# Most messages of one call of `take`: a writer faster than the reader must not block the reader's node.
_MAX_TAKEN = 10_000


class ReceivedMessage(NamedTuple):
    """A serialised message and the time at which the middleware received it, ns since the epoch."""

    data: bytes
    received_ns: int


class MessageBuffer:
    """
    Takes the messages that wait in the queue of a subscription the executor does not serve.

    Parameters
    ----------
    subscription : rclpy.subscription.Subscription
        Of serialised messages (``raw=True``).
    """

    def __init__(self, subscription: Any) -> None:
        self.subscription = subscription

    def take(self) -> list[ReceivedMessage]:
        """All messages that wait, oldest first."""
        taken: list[ReceivedMessage] = []
        reader, msg_type = self.subscription.handle, self.subscription.msg_type
        with reader:
            while len(taken) < _MAX_TAKEN and (found := reader.take_message(msg_type, True)) is not None:
                taken.append(ReceivedMessage(found[0], found[1]["received_timestamp"]))
        return taken
