# SPDX-License-Identifier: Apache-2.0
"""
Live server of the graph's messages for Foxglove: raw bytes with the same schemas as in a recording.

Everyone who may connect can watch everything, and nothing can be changed. The server itself is the package
`foxglove-sdk`, an optional extra of this package.
"""

from __future__ import annotations

import asyncio
import dataclasses
import importlib
import re
import threading
from typing import Any

from mwd_sensors.core.settings import setting
from mwd_surface.bags.definitions import DefinitionError, Definitions, installed
from mwd_surface.loopback import port_problem, refused_host


class FoxgloveError(Exception):
    """Raised if the server cannot run; the message gives the reason and what to do."""


@dataclasses.dataclass(frozen=True)
class FoxgloveSettings:
    """Settings of the live server for Foxglove."""

    enabled: bool = setting(False, "Serve the topics live to Foxglove. Needs the extra package foxglove-sdk.")
    host: str = setting("127.0.0.1", "Address of the network interface on which the server listens.")
    port: int = setting(8765, "TCP port of the server. 0 selects a free port.", low=0, high=65535)
    allow_network: bool = setting(
        False, "Allow a host that other machines can reach. Without it only loopback addresses are accepted."
    )
    backlog: int = setting(
        1024,
        "Largest number of messages that wait for one client; beyond it the oldest are dropped. Raise it for a "
        "slow network; it costs memory.",
        low=16,
        high=1_000_000,
    )


class FoxgloveServer:
    """
    Foxglove server of one well.

    Parameters
    ----------
    name : str
        Name of the source shown by a client.
    definitions : Definitions, optional
        Source of schema texts; by default this installation.
    simulated_clock : bool
        Whether the time is simulated instead of wall-clock time; `set_time` then sends it to the clients.

    Raises
    ------
    FoxgloveError
        The address is not loopback and `allow_network` is not set.
    """

    def __init__(
        self,
        settings: FoxgloveSettings,
        name: str,
        definitions: Definitions | None = None,
        *,
        simulated_clock: bool = False,
    ) -> None:
        if why := refused_host(settings.host, allow_network=settings.allow_network):
            raise FoxgloveError(why)
        self._settings, self._name = settings, name
        self._definitions = definitions or installed()
        self._sdk: Any = None
        self._context: Any = None
        self._server: Any = None
        self._relay: HandshakeRelay | None = None
        self._simulated_clock = simulated_clock
        self._channels: dict[tuple[str, str], Any] = {}
        self._last: dict[int, tuple[bytes, int]] = {}
        self._lock = threading.Lock()
        self._wanted: list[tuple[str, str]] = []
        self.unknown: set[str] = set()

    def start(self) -> None:
        """
        Listen until `stop` is called.

        Raises
        ------
        FoxgloveError
            The package is missing, or the server cannot listen on its address.
        """
        try:
            self._sdk = importlib.import_module("foxglove")
        except ImportError as error:
            raise FoxgloveError(
                "the live Foxglove server needs the package foxglove-sdk, which is not installed:"
                " pip install foxglove-sdk"
            ) from error
        settings = self._settings
        self._context = self._sdk.Context()
        # Advertise before clients can connect, because a client that subscribes at once may miss a topic that appears
        # later.
        for topic, type_name in self._wanted:
            self._advertised(topic, type_name)
        try:
            self._server = self._sdk.start_server(
                name=self._name,
                # Clients connect through the relay, which accepts both names of the protocol.
                host="127.0.0.1",
                port=0,
                context=self._context,
                capabilities=[self._sdk.websocket.Capability.Time] if self._simulated_clock else [],
                server_listener=self._listener(),
                message_backlog_size=settings.backlog,
            )
            self._relay = HandshakeRelay(settings.host, settings.port, self._server.port)
        except (RuntimeError, OSError, ValueError) as error:
            self.stop()
            self._channels, self._context = {}, None
            why = port_problem(error, settings.host, settings.port) if isinstance(error, OSError) else str(error)
            raise FoxgloveError(why) from error

    @property
    def address(self) -> str:
        """Address ``ws://host:port`` of the running server; empty while it is not running."""
        return f"ws://{self._settings.host}:{self._relay.port}" if self._relay is not None else ""

    def advertise(self, topic: str, type_name: str) -> None:
        """Show a topic to viewers before its first message; topic: full name; type_name: ``package/msg/Name``."""
        self._wanted.append((topic, type_name))
        if self._server is not None:
            self._advertised(topic, type_name)

    def put(self, topic: str, type_name: str, data: bytes, log_ns: int, *, latched: bool = False) -> None:
        """
        Send one serialised message, without waiting; drop the message if the server is not running.

        Parameters
        ----------
        topic, type_name : str
            Full name, and ``package/msg/Name``.
        data : bytes
            Bytes as they came from the middleware.
        log_ns : int
            Time of reception, ns since the epoch.
        latched : bool
            Whether the last message is sent again to later subscribers.
        """
        if self._server is None:
            return
        channel = self._channels.get((topic, type_name))
        if channel is None:
            channel = self._advertised(topic, type_name)
            if channel is None:
                return
        if latched:
            with self._lock:
                self._last[channel.id()] = (data, log_ns)
        channel.log(data, log_time=log_ns)

    def set_time(self, now_ns: int) -> None:
        """Send the time, ns since the epoch, to the clients if it is simulated time."""
        if self._server is not None and self._simulated_clock:
            self._server.broadcast_time(now_ns)

    def stop(self) -> None:
        """Close all connections; the port is free a moment later. Does nothing if the server is not running."""
        relay, self._relay = self._relay, None
        if relay is not None:
            relay.stop()
        server, self._server = self._server, None
        if server is None:
            return
        for channel in self._channels.values():
            channel.close()
        self._channels = {}
        server.stop()
        self._context = None

    def _advertised(self, topic: str, type_name: str) -> Any:
        if type_name in self.unknown:
            return None
        try:
            definition = self._definitions.definition(type_name)
        except DefinitionError:
            self.unknown.add(type_name)
            return None
        schema = self._sdk.Schema(name=type_name, encoding="ros2msg", data=definition.text.encode())
        channel = self._sdk.Channel(topic, schema=schema, message_encoding="cdr", context=self._context)
        self._channels[topic, type_name] = channel
        return channel

    def _listener(self) -> Any:
        """Return the listener that the SDK calls in its own threads; only subscriptions matter here."""
        # The SDK's base class ignores all other events.
        answers = {"on_subscribe": lambda _own, _client, channel: self._again(channel.id)}
        return type("Listener", (self._sdk.ServerListener,), answers)()

    def _again(self, channel_id: int) -> None:
        """Send the last message of a latched topic to a new subscriber."""
        with self._lock:
            last = self._last.get(channel_id)
        channel = next((c for c in list(self._channels.values()) if c.id() == channel_id), None)
        if last is not None and channel is not None:
            channel.log(last[0], log_time=last[1])


# Relay through which Foxglove clients with the older protocol name can connect: it changes one word of the handshake.


NEW, OLD = b"foxglove.sdk.v1", b"foxglove.websocket.v1"  # names of the WebSocket subprotocol
_HEADER = re.compile(rb"^sec-websocket-protocol:[^\r\n]*", re.IGNORECASE | re.MULTILINE)
MOST_CONNECTIONS = 32
_HANDSHAKE_S = 10.0
_CHUNK = 1 << 16


def renamed(head: bytes, old: bytes, new: bytes) -> tuple[bytes, bool]:
    """
    Change the subprotocol name in the head of a request or an answer; return the head and whether it was changed.

    A head that already has the new name is left unchanged, because its sender supports the new name.
    """
    line = _HEADER.search(head)
    if line is None or new in line.group() or old not in line.group():
        return head, False
    return head[: line.start()] + line.group().replace(old, new) + head[line.end() :], True


class HandshakeRelay:
    """
    Relay that listens on an address and forwards connections to a server on the loopback of this machine.

    Parameters
    ----------
    host, port : str, int
        Address to listen on; port 0 selects a free port.
    inner_port : int
        Port of the server.

    Attributes
    ----------
    port : int
        Port on which the relay listens.

    Raises
    ------
    OSError
        The address cannot be opened.
    """

    def __init__(self, host: str, port: int, inner_port: int) -> None:
        self._inner_port = inner_port
        self._connections: set[asyncio.Task[None]] = set()
        self._loop = asyncio.new_event_loop()
        try:
            server = self._loop.run_until_complete(asyncio.start_server(self._relay, host, port))
        except OSError:
            self._loop.close()
            raise
        self.port = int(server.sockets[0].getsockname()[1])
        self._server = server
        self._thread = threading.Thread(target=self._run, name="foxglove-relay", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close all connections, and wait up to 2 s for the end of the thread."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(timeout=2.0)

    def _run(self) -> None:
        self._loop.run_forever()
        self._loop.run_until_complete(self._close())
        self._loop.close()

    async def _close(self) -> None:
        self._server.close()
        for task in self._connections:
            task.cancel()
        await asyncio.gather(*self._connections, return_exceptions=True)

    async def _relay(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if task is None:
            raise RuntimeError("a connection is served in a task of the loop")
        if len(self._connections) >= MOST_CONNECTIONS:
            # Each connection costs two file handles, which page and recorder need too.
            writer.close()
            return
        self._connections.add(task)
        inner: asyncio.StreamWriter | None = None
        try:
            async with asyncio.timeout(_HANDSHAKE_S):
                request, old = renamed(await reader.readuntil(b"\r\n\r\n"), OLD, NEW)
                answers, inner = await asyncio.open_connection("127.0.0.1", self._inner_port)
                inner.write(request)
                answer = await answers.readuntil(b"\r\n\r\n")
            writer.write(renamed(answer, NEW, OLD)[0] if old else answer)
            ways = [asyncio.ensure_future(_pass(*way)) for way in ((reader, inner), (answers, writer))]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)
        except (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            # There was no handshake, or the other side has closed the connection, so no answer can be sent.
            return
        finally:
            for one in (writer, inner):
                if one is not None:
                    one.close()
            self._connections.discard(task)


async def _pass(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Forward bytes until the end; a slow reader blocks the sender, so that the server drops its oldest messages."""
    while data := await reader.read(_CHUNK):
        writer.write(data)
        await writer.drain()
