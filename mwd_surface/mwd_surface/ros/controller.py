# SPDX-License-Identifier: Apache-2.0
"""A controller's side of control on the graph: it asks, sends set-points and heartbeats, and gives back, sealed."""

from __future__ import annotations

from typing import Any

from mwd_msgs import msg, srv

from mwd_sensors.ros.qos import STATE
from mwd_surface.ros.seal import Sealer


class Controller:
    """
    Entities of one controller on a node.

    Parameters
    ----------
    node : rclpy.node.Node
    name : str
        Of the controller, as people see it.
    private_key : bytes, optional
        Of 32 bytes; a controller that keeps it in a file is the same one after a restart.

    Attributes
    ----------
    lease : int
        Number under which set-points are sent; 0: none. The caller sets it from the answer to `ask`.
    """

    def __init__(self, node: Any, name: str, private_key: bytes | None = None) -> None:
        self.name, self.lease, self.sequence = name, 0, 0
        self._sealer = Sealer(private_key)
        self._request = node.create_client(srv.RequestControl, "request_control")
        self._release = node.create_client(srv.ReleaseControl, "release_control")
        self._commands = node.create_publisher(msg.SealedCommand, "control/command", STATE)
        self._names = [node.resolve_service_name(name) for name in ("request_control", "release_control")]

    @property
    def ready(self) -> bool:
        """Whether the authority is there."""
        return bool(self._request.service_is_ready() and self._commands.get_subscription_count())

    def ask(self, **wish: Any) -> Any:
        """Ask for control, or prolong the lease; wish: fields of RequestControl. Returns the future of the answer."""
        wanted = srv.RequestControl.Request(controller=self.name, **wish)
        return self._request.call_async(self._sealer.seal(self._names[0], wanted))

    def command(self, command: Any) -> None:
        """Send a set-point, a RigCommand, under the next number of the lease."""
        self.sequence += 1
        command.lease, command.sequence = self.lease, self.sequence
        self.send(command)

    def heartbeat(self) -> None:
        """Say that the controller lives: what it asked for stays valid for its time again."""
        self.send(msg.RigCommand(lease=self.lease))

    def send(self, command: Any) -> None:
        """Send a RigCommand with lease and sequence as they are."""
        self.publish(self.sealed(command))

    def sealed(self, command: Any) -> Any:
        """Return a RigCommand with lease and sequence as they are, sealed."""
        return self._sealer.seal(self._commands.topic_name, msg.SealedCommand(command=command))

    def publish(self, sealed: Any) -> None:
        """Send a SealedCommand as it is."""
        self._commands.publish(sealed)

    def release(self, reason: str = "") -> Any:
        """Give the lease back; returns the future of the answer."""
        wanted = srv.ReleaseControl.Request(lease=self.lease, reason=reason)
        self.lease = self.sequence = 0
        return self._release.call_async(self._sealer.seal(self._names[1], wanted))
