"""The live Foxglove server on the graph: off unless switched on, tried again where its port is taken."""

from __future__ import annotations

import time
from typing import Any

from mwd_sensors.ros.lifecycle_node import ERROR, OK, WARN, Finding, GraphNode
from mwd_surface.live.alarms import Severity
from mwd_surface.page.foxglove_server import FoxgloveError, FoxgloveServer, FoxgloveSettings
from mwd_surface.ros.alarm_log import Journal

_RETRY = 10.0  # s between tries


class FoxgloveDoor:
    """
    The live server of one well.

    Raises
    ------
    FoxgloveError
        Its settings contradict each other.
    """

    def __init__(self, node: GraphNode[Any], settings: FoxgloveSettings, journal: Journal) -> None:
        self._node, self._journal = node, journal
        self._server = FoxgloveServer(settings, node.get_namespace()) if settings.enabled else None
        self._why = ""
        self._tried = -_RETRY

    @property
    def put(self) -> Any:
        """Where every message goes; None where the server is switched off."""
        return self._server.put if self._server is not None else None

    def advertise(self, topic: str, type_name: str) -> None:
        """Show a topic to viewers before its first message."""
        if self._server is not None:
            self._server.advertise(topic, type_name)

    def open(self) -> None:
        """Serve; where that cannot be, say so and try again later."""
        server = self._server
        if server is None or server.address or time.monotonic() - self._tried < _RETRY:
            return
        self._tried = time.monotonic()
        try:
            server.start()
        except FoxgloveError as error:
            self._why = str(error)
            self._journal.alarm("foxglove", Severity.WARNING, f"no live Foxglove server: {error}")
            return
        self._why = ""
        self._journal.clear("foxglove")
        self._node.get_logger().info(f"foxglove: {server.address}")

    def close(self) -> None:
        """Give the port free."""
        if self._server is not None:
            self._server.stop()

    def findings(self) -> list[Finding]:
        """How the server is."""
        server = self._server
        if server is None:
            return []
        if not server.address:
            return [Finding("foxglove", ERROR, self._why, "install the package, or set another foxglove.port")]
        if server.unknown:
            text = f"{server.address}, without {', '.join(sorted(server.unknown))}"
            return [Finding("foxglove", WARN, text, "install the packages that define these messages")]
        return [Finding("foxglove", OK, server.address)]
