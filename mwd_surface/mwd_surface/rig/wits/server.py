# SPDX-License-Identifier: Apache-2.0
"""WITS level 0 server over TCP: recorders and collectors connect, and each receives every packet."""

from __future__ import annotations

import asyncio
import dataclasses
import socket
from collections.abc import Callable

from mwd_sensors.core.settings import setting
from mwd_surface.rig.interface import LISTENING, STOPPED, InterfaceStatus, OnRigState, checked_host, port_error
from mwd_surface.rig.wits.link import Wits0Link, Wits0Settings

# Size of the send buffer, bytes; a larger one would delay the detection of a peer that does not read.
_KERNEL_BUFFER = 16384


@dataclasses.dataclass(frozen=True)
class Wits0ServerSettings:
    """Address and limits of the server."""

    enabled: bool = setting(False, "Serve WITS level 0 over TCP.")
    host: str = setting("127.0.0.1", "Address of the network interface on which the server listens.")
    port: int = setting(8686, "TCP port of the server. 0 selects a free port.", low=0, high=65535)
    allow_network: bool = setting(
        False, "Allow a host that other machines can reach. Without it only loopback addresses are accepted."
    )
    max_clients: int = setting(
        16, "Largest number of connections at a time. Further connections are refused.", low=1, high=500
    )
    max_per_peer: int = setting(
        8, "Largest number of connections from one address at a time. Further connections are refused.", low=1, high=500
    )


class Wits0Server(Wits0Link):
    """WITS level 0 server."""

    def __init__(
        self,
        settings: Wits0ServerSettings,
        talk: Wits0Settings | None = None,
        on_rig_state: OnRigState | None = None,
    ) -> None:
        super().__init__("wits0_server", talk or Wits0Settings(), on_rig_state)
        self.settings = settings
        self._of_host: dict[str, int] = {}

    async def serve(self, ready: Callable[[str], None], stop: asyncio.Event) -> None:
        """Listen until `stop` is set; raise InterfaceError if the host is not allowed or the port cannot be opened."""
        host = checked_host(self.settings.host, self.settings.allow_network)
        try:
            server = await asyncio.start_server(self._client, host, self.settings.port, limit=16384, backlog=64)
        except OSError as error:
            raise port_error(error, host, self.settings.port) from error
        bound = server.sockets[0].getsockname()
        ready(f"{bound[0]}:{bound[1]}")
        self._conversations: set[asyncio.Task[None]] = set()
        try:
            await self.send_due(stop)
        finally:
            server.close()
            self.end_all()
            await asyncio.gather(*self._conversations, return_exceptions=True)

    async def _client(self, reader: asyncio.StreamReader, stream: asyncio.StreamWriter) -> None:
        peername = stream.get_extra_info("peername") or ("unknown", 0)
        host = str(peername[0])
        if self.peers >= self.settings.max_clients or self._of_host.get(host, 0) >= self.settings.max_per_peer:
            self.refused += 1
            stream.close()
            return
        connection: socket.socket = stream.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL_BUFFER)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._of_host[host] = self._of_host.get(host, 0) + 1
        task = asyncio.current_task()
        if task is not None:
            self._conversations.add(task)
        try:
            await self.converse(reader, stream, f"{host}:{peername[1]}")
        finally:
            self._of_host[host] -= 1
            if not self._of_host[host]:
                del self._of_host[host]
            if task is not None:
                self._conversations.discard(task)

    def status(self) -> InterfaceStatus:
        """Return the state of the server."""
        return self.status_as(LISTENING if self.running else STOPPED, self.failure)
