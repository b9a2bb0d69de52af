# SPDX-License-Identifier: Apache-2.0
"""
Live server of the graph's messages for Foxglove: raw bytes with the same schemas as in a recording.

Everyone who may connect can watch everything, and nothing can be changed. The server itself is the package
`foxglove-sdk`, an optional extra of this package.
"""

from __future__ import annotations

import dataclasses
import importlib
import threading
from typing import Any

from mwd_sensors.core.settings import setting
from mwd_surface.bags.definitions import DefinitionError, Definitions, installed
from mwd_surface.loopback import refused_host


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
                host=settings.host,
                port=settings.port,
                context=self._context,
                capabilities=[self._sdk.websocket.Capability.Time] if self._simulated_clock else [],
                server_listener=self._listener(),
            )
        except (RuntimeError, OSError, ValueError) as error:
            self._channels, self._context = {}, None
            where = f"{settings.host} port {settings.port}"
            raise FoxgloveError(f"{where}: {error}; stop the program that uses the port, or set another") from error

    @property
    def address(self) -> str:
        """Address ``ws://host:port`` of the running server; empty while it is not running."""
        return f"ws://{self._settings.host}:{self._server.port}" if self._server is not None else ""

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
