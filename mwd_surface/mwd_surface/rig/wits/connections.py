# SPDX-License-Identifier: Apache-2.0
"""
WITS level 0 connections: a server for recorders that connect, a client of a recorder that listens, and a serial line.

Client and serial line retry without end. The wait doubles from one second to half a minute and varies at random, so
that a hundred units do not reconnect at the same time.
"""

from __future__ import annotations

import abc
import asyncio
import contextlib
import dataclasses
import os
import socket
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

from mwd_sensors.core.settings import setting
from mwd_surface.rig.interface import (
    CONNECTED,
    CONNECTING,
    LISTENING,
    STOPPED,
    Backoff,
    InterfaceStatus,
    OnRigState,
    checked_host,
    optional,
    port_error,
)
from mwd_surface.rig.wits.link import Wits0Link, Wits0Settings

# Client and serial line.

_CONNECT_S = 5.0  # longest wait for a TCP connection, s
_STEADY = 10.0  # length of a connection after which the wait starts again from the shortest, s


@dataclasses.dataclass(frozen=True)
class Wits0ClientSettings:
    """Address of the recorder and waits between attempts."""

    enabled: bool = setting(False, "Connect to a WITS recorder over TCP.")
    host: str = setting("127.0.0.1", "Address of the recorder.")
    port: int = setting(9872, "TCP port of the recorder.", low=1, high=65535)
    backoff: Backoff = setting(Backoff, "Waits between attempts to connect.")


@dataclasses.dataclass(frozen=True)
class Wits0SerialSettings:
    """Settings of the serial line to the recorder."""

    enabled: bool = setting(False, "Exchange WITS records over a serial line.")
    device: str = setting("/dev/ttyS0", "Serial device of the line.")
    baud: int = setting(9600, "Speed of the line in bits per second. Both ends must agree.", low=300, high=921600)
    backoff: Backoff = setting(Backoff, "Waits between attempts to open the line.")


class _Caller(Wits0Link, abc.ABC):
    """Interface that connects to one peer, and reconnects after each loss of the connection."""

    def __init__(
        self,
        name: str,
        where: str,
        backoff: Backoff,
        talk: Wits0Settings | None,
        on_rig_state: OnRigState | None,
    ) -> None:
        super().__init__(name, talk or Wits0Settings(), on_rig_state)
        self._where, self._backoff = where, backoff
        self.failures = 0
        self.connections = 0
        self._reason = ""

    @abc.abstractmethod
    def connection(self) -> contextlib.AbstractAsyncContextManager[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
        """
        Return a context manager that opens one connection and gives its reader and writer.

        Entering the context raises OSError if the connection cannot be opened.
        """

    async def serve(self, ready: Callable[[str], None], stop: asyncio.Event) -> None:
        """Connect, exchange data, and reconnect, until `stop` is set."""
        ready(self._where)
        tasks = [asyncio.ensure_future(work) for work in (self.send_due(stop), self._call(), stop.wait())]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _call(self) -> None:
        while True:
            try:
                async with self.connection() as (reader, writer):
                    began = time.monotonic()
                    self.connections += 1
                    self._reason = ""
                    await self.converse(reader, writer, self._where)
                self._reason = f"{self._where} ended the connection"
                self.failures = 0 if time.monotonic() - began >= _STEADY else self.failures + 1
            except (OSError, TimeoutError) as error:
                self.failures += 1
                self._reason = f"{self._where}: {error or 'no answer'}"
            await asyncio.sleep(self._backoff.wait(self.failures))

    def status(self) -> InterfaceStatus:
        """Return the state of the interface."""
        if not self.running:
            return self.status_as(STOPPED, self.failure)
        status = self.status_as(CONNECTED if self.peers else CONNECTING, self._reason)
        counts = (*status.counts, ("connections", self.connections), ("failures", self.failures))
        return dataclasses.replace(status, counts=counts)


class Wits0Client(_Caller):
    """WITS client over TCP."""

    def __init__(
        self,
        settings: Wits0ClientSettings,
        talk: Wits0Settings | None = None,
        on_rig_state: OnRigState | None = None,
    ) -> None:
        where = f"{settings.host}:{settings.port}"
        super().__init__("wits0_client", where, settings.backoff, talk, on_rig_state)
        self.settings = settings

    @contextlib.asynccontextmanager
    async def connection(self) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
        """Open a TCP connection."""
        async with asyncio.timeout(_CONNECT_S):
            reader, stream = await asyncio.open_connection(self.settings.host, self.settings.port, limit=16384)
        try:
            yield reader, stream
        finally:
            stream.transport.abort()


class Wits0Serial(_Caller):
    """WITS over a serial line with 8 data bits, no parity, 1 stop bit; POSIX terminals and pseudo-terminals."""

    def __init__(
        self,
        settings: Wits0SerialSettings,
        talk: Wits0Settings | None = None,
        on_rig_state: OnRigState | None = None,
    ) -> None:
        super().__init__("wits0_serial", settings.device, settings.backoff, talk, on_rig_state)
        self.settings = settings
        self._serial: Any = None

    def start(self) -> None:
        """
        Start the interface.

        Raises
        ------
        InterfaceError
            pyserial is not installed.
        """
        self._serial = optional("serial", "pyserial", "WITS over a serial line")
        super().start()

    @contextlib.asynccontextmanager
    async def connection(self) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
        """Open the device."""
        loop = asyncio.get_running_loop()
        device = await loop.run_in_executor(
            None, lambda: self._serial.Serial(self.settings.device, self.settings.baud, timeout=0, exclusive=True)
        )
        try:
            # Each stream closes its file descriptor, so give each its own copy.
            source, sink = os.fdopen(os.dup(device.fd), "rb", 0), os.fdopen(os.dup(device.fd), "wb", 0)
            reader = asyncio.StreamReader(limit=16384)
            incoming, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), source)
            # The stream of the writing side needs a reader too; nothing arrives on this stream.
            unread = asyncio.StreamReader()
            outgoing, protocol = await loop.connect_write_pipe(lambda: asyncio.StreamReaderProtocol(unread), sink)
            try:
                yield reader, asyncio.StreamWriter(outgoing, protocol, unread, loop)
            finally:
                incoming.close()
                outgoing.abort()
        finally:
            device.close()


# Server.

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
