# SPDX-License-Identifier: Apache-2.0
"""
Publisher for the topics of a node; if the middleware refuses a message, only this message is lost.

Fast DDS refuses a message if a lock, or a place in the writer's history, does not become free in time, as on an
overloaded machine ("cannot publish data", rmw_fastrtps issues 310 and 463). Raised inside a callback, the refusal of
one sample would also prevent everything that the callback publishes afterwards, such as a survey.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle.publisher import LifecyclePublisher

from mwd_sensors.core import wire

RCLError = rclpy_implementation.RCLError


class TopicPublisher(LifecyclePublisher):
    """Lifecycle publisher that reports refusals of the middleware instead of raising them."""

    on_refusal: Callable[[Exception], None]  #: called with the error of each message that was not sent
    #: Called with each message that was passed to `publish` while the publisher is active.
    on_published: Callable[[Any], None] | None = None

    def publish(self, msg: Any) -> None:
        """
        Publish a message; if the middleware refuses it twice, call `on_refusal`.

        An inactive publisher publishes nothing.
        """
        try:
            super().publish(msg)
        except RCLError:
            try:
                super().publish(msg)
            except RCLError as error:
                self.on_refusal(error)
        if self.on_published is not None and self.is_activated:
            self.on_published(msg)

    def publish_rows(self, rows: wire.Rows) -> None:
        """
        Publish each row of serialised bytes, shape (n, size), as one message, in order.

        A refused message is reported, without a second try; `on_published` is not called. An inactive publisher
        publishes nothing.
        """
        if not len(rows) or not self.is_activated:
            return
        size, joined, writer = rows.shape[1], rows.tobytes(), self.handle
        with writer:
            for start in range(0, len(joined), size):
                try:
                    writer.publish_raw(joined[start : start + size])
                except RCLError as error:
                    self.on_refusal(error)
