# SPDX-License-Identifier: Apache-2.0
"""
Topics, services and actions that the middleware refuses to create, as it does without an SROS2 permission.

The middleware's own error names neither the topic nor the permission (rmw_fastrtps: "could not create data writer").
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from rclpy.impl.implementation_singleton import rclpy_implementation

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
