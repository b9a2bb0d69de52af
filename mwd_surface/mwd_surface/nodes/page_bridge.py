# SPDX-License-Identifier: Apache-2.0
"""Live page in the surface node: start of its web server, and calls of the node's services by the page's buttons."""

from __future__ import annotations

import concurrent.futures
import math
import os
import time
from collections.abc import Callable, Mapping
from typing import Any

from mwd_msgs import srv

from mwd_sensors.core.foreign_text import printable
from mwd_sensors.ros.deferred import DeferredResponse
from mwd_sensors.ros.diagnostics import ERROR, OK, Diagnostic
from mwd_sensors.ros.request_rules import refusal
from mwd_surface.live.alarms import Severity
from mwd_surface.nodes.settings import SurfaceSettings
from mwd_surface.page.commands import read_token
from mwd_surface.page.page_server import PageServer
from mwd_surface.page.state_json import StateJson
from mwd_surface.ros.context import Answer, SurfaceContext

_RETRY_S = 5.0  # time between two attempts to start the server, s

Services = Mapping[str, tuple[Any, Callable[[Any, Any], Any]]]  #: type and callback of each service, by its name


class PageBridge:
    """Live page of one well."""

    def __init__(self, context: SurfaceContext, settings: SurfaceSettings) -> None:
        self._context, self._settings = context, settings
        self._state_json = StateJson(context.live.settings)
        self._server: PageServer | None = None
        self._tried_at = -_RETRY_S

    def open(self) -> None:
        """
        Serve the page if it is not served yet, at most once every `_RETRY_S`; raise an alarm if its port is in use.

        Raises
        ------
        OSError
            The port is in use and `strict` is set.
        ValueError
            The settings of the page contradict each other.
        """
        if not self._settings.serve_page or self._server is not None or time.monotonic() - self._tried_at < _RETRY_S:
            return
        self._tried_at = time.monotonic()
        alarm_log = self._context.alarm_log
        token = read_token(self._settings.page.token_file, os.environ)
        server = PageServer(
            self._settings.page,
            self._context.requests.call,
            token=token,
            now=lambda: self._context.well_now,
            exports=self._context.folder / "exports",
        )
        try:
            server.start()
        except OSError as error:
            if self._settings.strict:
                raise
            alarm_log.raise_alarm(
                "page.port", Severity.WARNING, f"no live page: {error}", "the start is retried every 5 s"
            )
            return
        self._server = server
        alarm_log.clear_alarm("page.port")
        self._context.node.get_logger().info(printable(f"page: {server.address}"))

    def close(self) -> None:
        """Release the port."""
        if self._server is not None:
            self._server.stop()
        self._server = None

    def update(self, *, without_clients: bool = False) -> None:
        """
        Send the state of the well to the page.

        without_clients: True sends the state even if no browser is connected, so that a program that reads the state
        only once gets a recent one.
        """
        if self._server is not None and (without_clients or self._server.clients):
            self._server.push(self._state_json.snapshot(self._context.state()))

    def diagnostics(self) -> list[Diagnostic]:
        """Return a diagnostic with the state of the page's server; none if no page is to be served."""
        if self._server is not None:
            return [Diagnostic("page", OK, f"{self._server.address}, {self._server.clients} watching")]
        if not self._settings.serve_page:
            return []
        return [Diagnostic("page", ERROR, "not served", f"is port {self._settings.page.port} free?")]


def call_service(
    services: Services, name: str, arguments: Mapping[str, Any]
) -> Answer | concurrent.futures.Future[Answer]:
    """Call the callback of a service of this node for a button of the page; return the answer or its future."""
    srv_type, callback = services[name]
    request = srv_type.Request()
    if srv_type is srv.JudgeSurvey:
        request.measured_depth = math.nan
    for field, value in arguments.items():
        setattr(request, field, value)
    if reason := refusal(request):
        return False, reason
    response = callback(request, srv_type.Response())
    if not isinstance(response, DeferredResponse):
        return response.success, response.message
    answer: concurrent.futures.Future[Answer] = concurrent.futures.Future()
    response.send_through(lambda known: answer.set_result((known.success, known.message)))
    return answer
