# SPDX-License-Identifier: Apache-2.0
"""
Report what the middleware refuses: topics, services and actions, such as without an SROS2 permission, and messages.

The middleware's own error names neither the topic nor the permission (rmw_fastrtps: "could not create data writer").
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle.publisher import LifecyclePublisher

from mwd_sensors.core import wire

RCLError = rclpy_implementation.RCLError


class RefusedEntityError(RuntimeError):
    """The middleware refused to create a topic, service or action; the text gives its name and the remedy."""


@contextlib.contextmanager
def named_refusal(access: str, name: str) -> Iterator[None]:
    """
    Raise a `RefusedEntityError` in place of the middleware's error.

    Parameters
    ----------
    access : str
        Refused operation: a key of `KINDS` in `mwd_surface.ros.security_policy`, such as "publish".
    name : str
        Full name of the topic, service or action.
    """
    try:
        yield
    except RCLError as error:
        reason = str(error).splitlines()[0]
        lacking = f"; {LACKING_PERMISSION}" if is_enforced(os.environ) else ""
        raise RefusedEntityError(f"this node may not {access} {name}: {reason}{lacking}") from error


LACKING_PERMISSION = (
    "if the permissions of its enclave lack it, write the policy again (`mwd security`), sign it "
    "(`ros2 security create_permission`) and start the node again"
)


def is_enforced(environment: Mapping[str, str]) -> bool:
    """Return whether SROS2 is on and refuses topics, services and actions without a permission."""
    enabled = environment.get("ROS_SECURITY_ENABLE", "").lower() == "true"
    return enabled and environment.get("ROS_SECURITY_STRATEGY") == "Enforce"


def security_refusal(environment: Mapping[str, str], error: str) -> str:
    """Return in one sentence why a secured node does not start; empty if security is not enforced."""
    if not is_enforced(environment):
        return ""
    keystore = environment.get("ROS_SECURITY_KEYSTORE", "")
    if not keystore or not Path(keystore).is_dir():
        where = f"ROS_SECURITY_KEYSTORE is {keystore!r}, which is not a folder" if keystore else "there is no keystore"
        return f"security is enforced and {where}: make one (`ros2 security create_keystore`) and set the variable"
    if "security libraries" in error:
        return "security is enforced but this middleware has no security plugins: use the ROS 2 packages of apt"
    return (
        f"security is enforced and the node was refused: {error.splitlines()[0]}; it needs its keys and the rights to "
        "/rosout, /parameter_events and its parameter services: start it with `--ros-args --enclave /WELL/NODE`"
    )


RCLError = rclpy_implementation.RCLError


class TopicPublisher(LifecyclePublisher):
    """
    Lifecycle publisher that reports refusals of the middleware instead of raising them.

    Fast DDS refuses a message if a lock, or a place in the writer's history, does not become free in time, as on an
    overloaded machine ("cannot publish data", rmw_fastrtps issues 310 and 463). Raised inside a callback, the refusal
    of one sample would also prevent everything that the callback publishes afterwards, such as a survey.
    """

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
