# SPDX-License-Identifier: Apache-2.0
"""
The publisher of every topic of a node: a message that the middleware refuses costs that message only.

Fast DDS refuses a message where a lock or a place in the writer's history does not come free in time, as on a machine
without a processor to spare ("cannot publish data", rmw_fastrtps issues 310 and 463). Raised inside a callback, the
refusal of one sample would take with it whatever the callback publishes after it, such as a survey.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle.publisher import LifecyclePublisher

from mwd_sensors.core import wire

RCLError = rclpy_implementation.RCLError


class TopicPublisher(LifecyclePublisher):
    """
    A lifecycle publisher that reports refusals of the middleware instead of raising them.

    Attributes
    ----------
    on_refusal : callable
        Called with the error of each message that was not sent.
    on_published : callable or None
        Called with each message that was handed to `publish` while the publisher is active.
    """

    on_refusal: Callable[[Exception], None]
    on_published: Callable[[Any], None] | None = None

    def publish(self, msg: Any) -> None:
        """Publish a message, at a second try if need be; an inactive publisher publishes nothing."""
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
        """Publish each row of serialised bytes as a message, in order; an inactive publisher publishes nothing."""
        if not len(rows) or not self.is_activated:
            return
        size, joined, writer = rows.shape[1], rows.tobytes(), self.handle
        with writer:
            for start in range(0, len(joined), size):
                try:
                    writer.publish_raw(joined[start : start + size])
                except RCLError as error:
                    self.on_refusal(error)
