# SPDX-License-Identifier: Apache-2.0
"""Live server for Foxglove: disabled by default; the start is retried while its port is in use."""

from __future__ import annotations

import time
from typing import Any

from mwd_sensors.core.foreign_text import printable
from mwd_sensors.ros.diagnostics import ERROR, OK, WARN, Diagnostic
from mwd_surface.live.alarms import Severity
from mwd_surface.page.foxglove_server import FoxgloveError, FoxgloveServer, FoxgloveSettings
from mwd_surface.ros.context import SurfaceContext

_RETRY_S = 10.0  # time between two attempts to start the server, s


class FoxgloveBridge:
    """
    Forwarder of serialised messages to the live server of one well.

    Raises
    ------
    FoxgloveError
        The settings contradict each other.
    """

    def __init__(self, context: SurfaceContext, settings: FoxgloveSettings) -> None:
        self._node, self._alarm_log, self._now_ns = context.node, context.alarm_log, context.now_ns
        self._simulated = bool(context.node.get_parameter("use_sim_time").value)
        name = context.node.get_namespace()
        self._server = FoxgloveServer(settings, name, simulated_clock=self._simulated) if settings.enabled else None
        self._error = ""
        self._tried_at = -_RETRY_S

    @property
    def put(self) -> Any:
        """Function to call with every message, which sends it to the server; None if the server is disabled."""
        if self._server is None:
            return None
        return self._put_simulated if self._simulated else self._server.put

    def _put_simulated(self, topic: str, type_name: str, data: bytes, _received_ns: int, *, latched: bool) -> None:
        """
        Send a message to the server with the simulated time of the ROS graph as its time of reception.

        Messages before the first message of /clock are dropped, except latched ones.
        """
        now_ns = self._now_ns()
        # Skip messages before the first message of /clock: their time is 0, and plots of viewers would begin at 0.
        if self._server is not None and (now_ns > 0 or latched):
            self._server.put(topic, type_name, data, now_ns, latched=latched)

    def update(self) -> None:
        """Send the time of the graph to clients, if it is simulated; called twenty times a second."""
        if self._server is not None and self._simulated and (now_ns := self._now_ns()) > 0:
            self._server.set_time(now_ns)

    def advertise(self, topic: str, type_name: str) -> None:
        """Advertise a topic to viewers before its first message."""
        if self._server is not None:
            self._server.advertise(topic, type_name)

    def open(self) -> None:
        """Start the server if it does not run, at most every `_RETRY_S`; on failure raise an alarm."""
        server = self._server
        if server is None or server.address or time.monotonic() - self._tried_at < _RETRY_S:
            return
        self._tried_at = time.monotonic()
        try:
            server.start()
        except FoxgloveError as error:
            self._error = str(error)
            self._alarm_log.raise_alarm("foxglove", Severity.WARNING, f"no live Foxglove server: {error}")
            return
        self._error = ""
        self._alarm_log.clear_alarm("foxglove")
        self._node.get_logger().info(printable(f"foxglove: {server.address}"))

    def close(self) -> None:
        """Stop the server."""
        if self._server is not None:
            self._server.stop()

    def diagnostics(self) -> list[Diagnostic]:
        """Return a diagnostic with the state of the server; none if the server is disabled."""
        server = self._server
        if server is None:
            return []
        if not server.address:
            return [Diagnostic("foxglove", ERROR, self._error, "install the package, or set another foxglove.port")]
        if server.unknown:
            text = f"{server.address}, without {', '.join(sorted(server.unknown))}"
            return [Diagnostic("foxglove", WARN, text, "install the packages that define these messages")]
        return [Diagnostic("foxglove", OK, server.address)]
