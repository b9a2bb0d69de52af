# SPDX-License-Identifier: Apache-2.0
"""Controller of the rig on the ROS graph: sends signed requests, set-points, heartbeats and the release."""

from __future__ import annotations

from typing import Any

from mwd_msgs import msg, srv

from mwd_sensors.ros.qos import STATE
from mwd_surface.ros.seal import Sealer


class Controller:
    """
    Publisher and service clients of one controller of the rig.

    Parameters
    ----------
    name : str
        Name of the controller, shown to people.
    private_key : bytes, optional
        Key of 32 bytes. A controller that stores its key in a file has the same identity after a restart.
    """

    def __init__(self, node: Any, name: str, private_key: bytes | None = None) -> None:
        self.name, self.sequence = name, 0
        #: Lease number for set-points; 0: no lease. The caller sets the number from the answer to `ask`.
        self.lease = 0
        self._sealer = Sealer(private_key)
        self._request = node.create_client(srv.RequestControl, "request_control")
        self._release = node.create_client(srv.ReleaseControl, "release_control")
        self._commands = node.create_publisher(msg.SealedCommand, "control/command", STATE)
        self._names = [node.resolve_service_name(name) for name in ("request_control", "release_control")]

    @property
    def ready(self) -> bool:
        """Whether the authority is available."""
        return bool(self._request.service_is_ready() and self._commands.get_subscription_count())

    def ask(self, **wish: Any) -> Any:
        """Request control, or prolong the lease; wish: fields of RequestControl. Return the future of the answer."""
        wanted = srv.RequestControl.Request(controller=self.name, **wish)
        return self._request.call_async(self._sealer.seal(self._names[0], wanted))

    def command(self, command: Any) -> None:
        """Send a set-point (RigCommand) with the next number of the lease."""
        self.sequence += 1
        command.lease, command.sequence = self.lease, self.sequence
        self.send(command)

    def heartbeat(self) -> None:
        """Send a heartbeat, so that the present set-point holds for another `valid_for`."""
        self.send(msg.RigCommand(lease=self.lease))

    def send(self, command: Any) -> None:
        """Send a RigCommand with its lease and sequence unchanged."""
        self.publish(self.sealed(command))

    def sealed(self, command: Any) -> Any:
        """Return a sealed RigCommand, with its lease and sequence unchanged."""
        return self._sealer.seal(self._commands.topic_name, msg.SealedCommand(command=command))

    def publish(self, sealed: Any) -> None:
        """Send a SealedCommand unchanged."""
        self._commands.publish(sealed)

    def release(self, reason: str = "") -> Any:
        """Give the lease back; return the future of the answer."""
        wanted = srv.ReleaseControl.Request(lease=self.lease, reason=reason)
        self.lease = self.sequence = 0
        return self._release.call_async(self._sealer.seal(self._names[1], wanted))
