"""The driller's page on the graph: served, tried again where its port is taken, its buttons answered."""

from __future__ import annotations

import concurrent.futures
import time
from collections.abc import Callable, Mapping
from typing import Any

from mwd_msgs import srv

from mwd_sensors.ros.lifecycle_node import ERROR, OK, Finding, GraphNode, Later
from mwd_surface.live.alarms import Severity
from mwd_surface.live.live_state import LiveState
from mwd_surface.page.page_server import Command, PageServer, PageSettings
from mwd_surface.page.state_json import StateJson
from mwd_surface.ros.alarm_log import Journal
from mwd_surface.ros.worker import Answer

_RETRY = 5.0  # s between tries to serve a page that could not be served

Services = Mapping[str, tuple[Any, Callable[[Any, Any], Any]]]


class PageDoor:
    """
    The page of one well.

    Parameters
    ----------
    strict : bool
        Refuse to start without the page, instead of trying again.
    ask : callable
        Where the page's buttons go, called in a thread of the server.
    """

    def __init__(
        self,
        node: GraphNode[Any],
        settings: PageSettings,
        *,
        serve: bool,
        strict: bool,
        live: LiveState,
        journal: Journal,
        ask: Command,
    ) -> None:
        self._node, self._settings, self._live, self._journal, self._ask = node, settings, live, journal, ask
        self._serve, self._strict = serve, strict
        self._tables = StateJson(live.settings)
        self._server: PageServer | None = None
        self._tried = -_RETRY

    def open(self) -> None:
        """
        Serve the page; where its port is taken, say so and try again later.

        Raises
        ------
        OSError
            The port is taken and `strict` is set.
        ValueError
            The settings of the page contradict each other.
        """
        if not self._serve or self._server is not None or time.monotonic() - self._tried < _RETRY:
            return
        self._tried = time.monotonic()
        server = PageServer(self._settings, self._ask)
        try:
            server.start()
        except OSError as error:
            if self._strict:
                raise
            self._journal.alarm("page.port", Severity.WARNING, f"no live page: {error}", "it is tried every 5 s")
            return
        self._server = server
        self._journal.clear("page.port")
        self._node.get_logger().info(f"page: {server.address}")

    def close(self) -> None:
        """Give the port free."""
        if self._server is not None:
            self._server.stop()
        self._server = None

    def show(self, now: float, *, even_unwatched: bool = False) -> None:
        """Bring the page what is new; even_unwatched: also for one who asks without watching."""
        if self._server is not None and (even_unwatched or self._server.clients):
            self._server.push(self._tables.snapshot(self._live.at(now)))

    def findings(self) -> list[Finding]:
        """How the page is."""
        if self._server is not None:
            return [Finding("page", OK, f"{self._server.address}, {self._server.clients} watching")]
        if not self._serve:
            return []
        return [Finding("page", ERROR, "not served", f"is port {self._settings.port} free?")]


def called(services: Services, name: str, arguments: Mapping[str, Any]) -> Answer | concurrent.futures.Future[Answer]:
    """Do what a button of the page asks as if its service had been called; the answer, or a promise of it."""
    kind, act = services[name]
    request = kind.Request()
    if kind is srv.JudgeSurvey:
        request.measured_depth = -1.0
    for field, value in arguments.items():
        setattr(request, field, value)
    response = act(request, kind.Response())
    if not isinstance(response, Later):
        return response.success, response.message
    known: concurrent.futures.Future[Answer] = concurrent.futures.Future()
    response.bind(lambda late: known.set_result((late.success, late.message)))
    return known
