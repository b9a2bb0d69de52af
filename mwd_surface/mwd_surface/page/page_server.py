# SPDX-License-Identifier: Apache-2.0
"""
Server of the driller's page that pushes the state to every browser, in one thread with its own event loop.

Each client gets the changes since its last message, at a bounded rate. A slow client skips states instead of queueing
them, so memory does not grow. The page is read-only; commands need a token and go to a callback. Protection against the
open web: loopback unless set otherwise, checks of Host and Origin (against DNS rebinding), a content policy without
other sources, limits on size, time and number of connections.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import errno
import ipaddress
import logging
import mimetypes
import socket
import threading
import time
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

from aiohttp import WSMsgType, web
from aiohttp.http_exceptions import HttpProcessingError

from mwd_sensors.core import budgets
from mwd_sensors.core.foreign_text import not_a_file_name
from mwd_surface.exports.export import FORMATS
from mwd_surface.language.language import language
from mwd_surface.loopback import port_problem, refused_host
from mwd_surface.page.commands import (
    COMMANDS,
    Command,
    SecretAccess,
    checked_arguments,
    is_safe,
    json_object,
    may_be_safe,
    read_body,
)
from mwd_surface.page.settings import PageSettings
from mwd_surface.page.state_feed import Client, Seen, StateFeed, dumps

# Files of the page, read once and served from memory.


PAGE = Path(__file__).parent / "static"


def page_files(folder: Path) -> dict[str, tuple[bytes, str]]:
    """
    Return content and media type of all files of the page, by address; no other files are served.

    Raises FileNotFoundError if index.html is missing.
    """
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not any(part.startswith((".", "__")) for part in path.relative_to(folder).parts):
            kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
            if path.suffix == ".js":
                kind = "text/javascript"
            found[path.relative_to(folder).as_posix()] = (path.read_bytes(), kind)
    if "index.html" not in found:
        raise FileNotFoundError(errno.ENOENT, "the page's files are missing; install mwd_surface again", str(folder))
    return found


def words_handler(default: str) -> Callable[[web.Request], Awaitable[web.Response]]:
    """
    Return the handler of ``words.json?lang=CODE``.

    default: language for a request without a code, or with a code that has no catalogue.

    Raises
    ------
    ValueError
        The default language has no catalogue.
    """
    language(default)

    def text(code: str) -> str:
        try:
            return dumps(language(code).table())
        except ValueError:
            return dumps(language(default).table())

    async def send(request: web.Request) -> web.Response:
        body = await asyncio.to_thread(text, request.query.get("lang") or default)
        return web.Response(text=body, content_type="application/json", headers={"Cache-Control": "no-cache"})

    return send


def sender(body: bytes, kind: str) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
    """Return a handler that sends a file from memory."""
    # The browser keeps a font for a week, because it is large and does not change. Other files change with the program.
    kept = "max-age=604800" if kind.startswith("font/") else "no-cache"

    async def send(_request: web.Request) -> web.StreamResponse:
        charset = "utf-8" if kind.startswith("text/") else None
        return web.Response(body=body, content_type=kind, charset=charset, headers={"Cache-Control": kept})

    return send


_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Server": "mwd",
}
_WAIT = "too many wrong tokens: try again in {} s"
_BUSY = b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 5\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"


class PageServer:
    """
    Page server of one well.

    Parameters
    ----------
    on_command : callable, optional
        `on_command(name, arguments) -> (ok, message)`, called one at a time in a thread of the server. Commands that
        deny or abort use a second thread. Arguments are checked against `COMMANDS`. None, or an empty token: read-only.
    token : str
        Secret that commands need (`commands.read_token`).
    clock : callable
        Steady time, s.
    page : Path
        Folder of the page's files, which are read once at start.
    on_replay : callable, optional
        Called with the checked request of `replay_handler`, for a page that plays a recording.
    now : callable, optional
        Clock of the times in the snapshots, s; by default `clock`. For a recording: time in the recording.
    exports : Path, optional
        Folder of the exported files, which anybody with the token can download.

    Raises
    ------
    ValueError
        The address is not loopback and `allow_network` is not set, the token is too short, or the language is unknown.
    """

    def __init__(
        self,
        settings: PageSettings | None = None,
        on_command: Command | None = None,
        clock: Callable[[], float] = time.monotonic,
        page: Path = PAGE,
        *,
        token: str = "",
        on_replay: OnReplay | None = None,
        now: Callable[[], float] | None = None,
        exports: Path | None = None,
    ) -> None:
        self.settings = settings or PageSettings()
        if why := refused_host(self.settings.host, allow_network=self.settings.allow_network):
            raise ValueError(why)
        self.refused = 0
        self._words = words_handler(self.settings.language)
        self._access = SecretAccess(token, clock) if token else None
        self._on_command = on_command if token else None
        self._page, self._exports = page, exports
        self._feed = StateFeed(1.0 / self.settings.max_rate, self.settings.send_timeout, clock, now or clock)
        self._on_replay = on_replay
        if self._on_command is not None:
            self._feed.own |= {"controls": True, "exports": [[kind, made.what] for kind, made in FORMATS.items()]}
        self._feed.own["time_zone"] = self.settings.time_zone
        # Connections that have not sent a complete request yet, oldest first.
        self._silent: dict[Any, None] = {}
        self._executor: concurrent.futures.ThreadPoolExecutor | None = None
        self._safe_executor: concurrent.futures.ThreadPoolExecutor | None = None
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop: asyncio.Event | None = None
        self._started: concurrent.futures.Future[tuple[str, int]] = concurrent.futures.Future()
        self._address: tuple[str, int] | None = None

    @property
    def address(self) -> str:
        """
        Address `http://host:port/` of the running page.

        Raises
        ------
        RuntimeError
            The page is not running.
        """
        if self._address is None:
            raise RuntimeError("the page is not running; call start first")
        host, port = self._address
        return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"

    @property
    def clients(self) -> int:
        """Number of browsers watching now."""
        return len(self._feed.clients)

    @property
    def skipped(self) -> int:
        """Number of states that slow clients did not get."""
        return self._feed.skipped

    def push(self, snapshot: Mapping[str, Any]) -> None:
        """
        Replace the state (`StateJson.snapshot`); may be called from any thread.

        If the snapshot has a dict `server`, its entries are sent with the server's own data, in the same message as the
        state. The snapshot is not copied: do not change it afterwards.
        """
        self._feed.snapshot = snapshot
        loop = self._loop
        if loop is not None and self._feed.clients:
            try:
                loop.call_soon_threadsafe(self._feed.wake)
            except RuntimeError:
                # The loop was closed after the check above, so no client is left.
                return

    def start(self) -> None:
        """
        Listen and serve until `stop` is called.

        Raises
        ------
        OSError
            The port is taken or not allowed (the message names it), or the page does not start within 10 s.
        RuntimeError
            The page is already running.
        """
        if self._thread is not None:
            raise RuntimeError("the page is already running")
        self._started = concurrent.futures.Future()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)
        self._thread.start()
        try:
            self._address = self._started.result(timeout=10.0)
        except OSError:
            self._thread.join(timeout=1.0)
            self._thread = None
            raise

    def stop(self) -> None:
        """Close all connections and end the thread within a second; does nothing if the page is not running."""
        thread, loop, stop = self._thread, self._loop, self._stop
        self._thread, self._address = None, None
        if thread is None or loop is None or stop is None:
            return
        loop.call_soon_threadsafe(stop.set)
        thread.join(timeout=1.0)

    # Methods that run in the server's thread.

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except OSError as error:
            if self._started.done():
                raise
            self._started.set_exception(error)
        finally:
            self._loop = None
            if not self._started.done():
                self._started.set_exception(OSError("the page did not start"))

    async def _serve(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        application = web.Application(middlewares=[self._guard], client_max_size=budgets.PAGE.size)
        files = await asyncio.to_thread(page_files, self._page)
        for name, (body, kind) in files.items():
            application.router.add_get("/" + name, sender(body, kind))
        application.router.add_get("/", sender(*files["index.html"]))
        application.router.add_get("/words.json", self._words)
        application.router.add_get("/state.json", self._state)
        application.router.add_get("/live", self._live)
        application.router.add_post("/command/{name}", self._command)
        if self._exports is not None:
            add_export_routes(application.router, self._exports, self._with_token)
        if self._on_replay is not None:
            application.router.add_post("/replay", replay_handler(self._on_replay, self.settings.request_timeout))
        runner = web.AppRunner(
            application, access_log=None, logger=request_logger(), shutdown_timeout=0.2, keepalive_timeout=5.0
        )
        await runner.setup()
        server = runner.server
        if server is None:
            raise OSError("the web server did not start")
        executor = self._executor = concurrent.futures.ThreadPoolExecutor(1, "page-command")
        safe_executor = self._safe_executor = concurrent.futures.ThreadPoolExecutor(1, "page-abort")
        host, port = self.settings.host, self.settings.port
        try:
            listening = await asyncio.to_thread(listener, host, port)
        except OSError as error:
            await runner.cleanup()
            executor.shutdown(wait=False)
            safe_executor.shutdown(wait=False)
            raise OSError(max(error.errno or 0, 0), f"page: {port_problem(error, host, port)}") from error
        bound = listening.getsockname()
        self._started.set_result((bound[0], bound[1]))
        accepting = asyncio.create_task(self._accept(listening, server))
        await self._stop.wait()
        accepting.cancel()
        listening.close()
        goodbyes = [client.socket.close(code=1001, message=b"the page ends") for client in self._feed.clients]
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(asyncio.gather(*goodbyes, return_exceptions=True), 0.3)
        await runner.cleanup()
        executor.shutdown(wait=False, cancel_futures=True)
        safe_executor.shutdown(wait=False, cancel_futures=True)

    async def _accept(self, listening: socket.socket, server: web.Server) -> None:
        """Accept connections up to the limits; drop connections that do not send a complete request in time."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, peer = await loop.sock_accept(listening)
            except OSError:
                # No file handle is free, or the other side has closed; the next connection may succeed.
                await asyncio.sleep(0.05)
                continue
            if not self._has_room(server, peer[0]):
                self.refused += 1
                with contextlib.suppress(OSError):
                    connection.send(_BUSY)
                connection.close()
                continue
            try:
                _, protocol = await loop.connect_accepted_socket(server, connection)
            except OSError:
                connection.close()
                continue
            self._silent[protocol] = None
            loop.call_later(self.settings.request_timeout, self._expire, protocol)

    def _has_room(self, server: web.Server, peer: str) -> bool:
        """Return whether a connection from an address is accepted; drop a connection without a request to make room."""
        there = [peer_of(handler.transport) for handler in server.connections]
        full = len(there) >= self.settings.max_connections
        if not full and there.count(peer) < self.settings.max_per_peer:
            return True
        for protocol in self._silent:
            if full or peer_of(protocol.transport) == peer:
                self._expire(protocol)
                return True
        return False

    def _expire(self, protocol: Any) -> None:
        if protocol in self._silent and protocol.transport is not None:
            protocol.transport.abort()
        self._silent.pop(protocol, None)

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        self._silent.pop(request.protocol, None)
        try:
            self._check_origin(request)
            response = await handler(request)
        except web.HTTPException as error:
            response = _json({"ok": False, "message": error.text or error.reason}, error.status)
            for name, value in error.headers.items():
                if name == "Allow":
                    response.headers[name] = value
        if not response.prepared:
            response.headers.update(_HEADERS)
            # Close after each request, so that an idle connection does not occupy a place.
            response.force_close()
        return response

    def _check_origin(self, request: web.Request) -> None:
        host = request.headers.get("Host", "")
        if not self._is_ours(host):
            raise web.HTTPMisdirectedRequest(text=f"host {host[:100]!r} is not a name of this page")
        origin = request.headers.get("Origin")
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            raise web.HTTPForbidden(text="requests from other sites are refused")

    def _is_ours(self, host: str) -> bool:
        # An IP address cannot be rebound to another machine, but a foreign name can.
        name = host[1:].rpartition("]")[0] if host.startswith("[") else host.rpartition(":")[0] or host
        if name.lower() in ("localhost", *(h.lower() for h in self.settings.allowed_hosts)):
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True

    async def _state(self, _request: web.Request) -> web.StreamResponse:
        return web.Response(
            text=self._feed.message(Seen(), 0, cached=False)[0],
            content_type="application/json",
            headers={"Cache-Control": "no-store"},
        )

    async def _live(self, request: web.Request) -> web.StreamResponse:
        if request.headers.get("Upgrade", "").lower() != "websocket":
            raise web.HTTPUpgradeRequired(text="this address needs WebSocket; use /state.json for plain HTTP")
        if request.headers.get("Origin") is None and request.headers.get("Sec-Fetch-Site") not in (None, "same-origin"):
            raise web.HTTPForbidden(text="requests from other sites are refused")
        if len(self._feed.clients) >= self.settings.max_clients:
            self.refused += 1
            raise web.HTTPServiceUnavailable(text=f"{self.settings.max_clients} browsers are watching already")
        talk = web.WebSocketResponse(max_msg_size=1024, autoping=False, timeout=0.2, compress=False)
        await talk.prepare(request)
        if not isinstance(request.transport, asyncio.Transport):
            return talk
        # A ping follows each state; a browser sends only the answers to these pings, six bytes each.
        answers = round(60.0 * self.settings.max_rate * 16)
        QuietPeer(request.transport, budgets.PAGE.size + answers, time.monotonic)
        client = Client(talk, request.transport)
        self._feed.clients.add(client)
        sender = asyncio.create_task(self._feed.send(client))
        # Without its sender, an open socket would show the last state forever; abort it so that the browser reconnects.

        def ended(task: asyncio.Task[None]) -> None:
            if not task.cancelled() and task.exception() is not None:
                client.transport.abort()

        sender.add_done_callback(ended)
        try:
            async for message in talk:
                # A text or binary message ends the connection.
                if message.type == WSMsgType.PONG:
                    client.answered()
                elif message.type == WSMsgType.PING:
                    await talk.pong(message.data)
                elif message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                    break
        finally:
            self._feed.clients.discard(client)
            # Close the socket before cancelling: in Python 3.11 a wait that ends while it is cancelled loses the
            # cancellation, and the sender would continue; a closed socket ends it anyway. When the page stops, this may
            # run before the closing message of `_serve`.
            await talk.close(code=1001 if self._stop is not None and self._stop.is_set() else 1000)
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)
        return talk

    async def _with_token(self, request: web.Request, *, may_be_safe: bool = False) -> int:
        """
        Refuse a request without the right token; return the remaining lock-out time of its address, s.

        may_be_safe: whether to accept the right token from a locked-out address. An attacker may share the operator's
        address, so commands that only return control of the rig are not locked out.

        Raises web.HTTPException: 403 without a configured token, 429 for a locked-out address, 401 for a missing or
        wrong token.
        """
        if self._access is None:
            raise web.HTTPForbidden(text="this page is read-only: no token is configured")
        peer = peer_of(request.transport)
        wait_s = self._access.wait_s(peer)
        if wait_s and not may_be_safe:
            raise web.HTTPTooManyRequests(text=_WAIT.format(wait_s))
        kind, _, given = request.headers.get("Authorization", "").partition(" ")
        if kind != "Bearer" or not self._access.allows(peer, given, forgive=not wait_s):
            # Slow down guessing without blocking other clients.
            await asyncio.sleep(0.3)
            raise (
                web.HTTPTooManyRequests(text=_WAIT.format(wait_s))
                if wait_s
                else web.HTTPUnauthorized(text="the token is missing or wrong")
            )
        return wait_s

    async def _command(self, request: web.Request) -> web.StreamResponse:
        if self._on_command is None:
            raise web.HTTPForbidden(text="this page is read-only: no token is configured")
        name = request.match_info["name"]
        wait_s = await self._with_token(request, may_be_safe=may_be_safe(name))
        if name not in COMMANDS:
            raise web.HTTPNotFound(text=f"unknown command {name[:60]!r}; choose one of {', '.join(COMMANDS)}")
        arguments = checked_arguments(name, await read_body(request, self.settings.request_timeout))
        safe = is_safe(name, arguments)
        if wait_s and not safe:
            raise web.HTTPTooManyRequests(text=_WAIT.format(wait_s))
        # Run an abort in its own thread, so that it does not wait for an export.
        executor = self._safe_executor if safe else self._executor
        work = asyncio.get_running_loop().run_in_executor(executor, self._on_command, name, arguments)
        try:
            ok, message = await asyncio.wait_for(work, self.settings.command_timeout)
        except ValueError as error:
            ok, message = False, str(error)
        except TimeoutError:
            raise web.HTTPGatewayTimeout(
                text=f"{name} has not finished yet; the event log will show the result"
            ) from None
        return _json({"ok": ok, "message": message}, 200 if ok else 409)


def _json(table: Mapping[str, Any], status: int) -> web.Response:
    return web.Response(text=dumps(table), status=status, content_type="application/json")


# Request that plays, pauses and seeks the page of a recording: POST /replay.


OnReplay = Callable[[dict[str, float | bool]], None]
_LONGEST_S, _FASTEST = 1e9, 1000.0  # largest time to go to, s, and largest rate of playback


def replay_handler(on_replay: OnReplay, timeout_s: float) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
    """
    Return the handler of POST /replay; the JSON may have playing (true or false), rate (0.01 to 1000) and seek (s).

    on_replay: called with the given fields in the thread of the server. timeout_s: longest wait for the body. The
    answer to a request with other fields or values has the status 400.
    """

    async def handle(request: web.Request) -> web.StreamResponse:
        on_replay(_checked(json_object(await read_body(request, timeout_s))))
        return web.json_response({"ok": True, "message": ""})

    return handle


def _checked(given: dict[str, Any]) -> dict[str, float | bool]:
    if not set(given) <= {"playing", "rate", "seek"}:
        raise web.HTTPBadRequest(text="expected a JSON object with playing, rate and seek")
    if not isinstance(given.get("playing", True), bool):
        raise web.HTTPBadRequest(text="playing: expected true or false")
    for name, low, high in (("rate", 0.01, _FASTEST), ("seek", 0.0, _LONGEST_S)):
        value = given.get(name, high)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        # Compare without conversion: an int may exceed the largest float. Infinity is above the limit, and NaN fails
        # every comparison.
        if not number or not low <= value <= high:
            raise web.HTTPBadRequest(text=f"{name}: expected a number from {low:g} to {high:g}")
    return given


# Route of the page to the exported files, so that a tablet without access to the surface unit's disk gets them.


_MOST = 200  # largest number of files in the list, the newest

Allowed = Callable[[web.Request], Awaitable[Any]]


def add_export_routes(router: web.UrlDispatcher, folder: Path, allowed: Allowed) -> None:
    """
    Add `/exports`, the list of exported files, newest first, and `/exports/NAME`, one of them as a download.

    allowed: function that is called with each request first; it raises `web.HTTPException` if the token is missing.
    """

    async def listed(request: web.Request) -> web.StreamResponse:
        await allowed(request)
        return web.json_response({"files": await asyncio.to_thread(exported_files, folder)}, dumps=dumps)

    async def sent(request: web.Request) -> web.StreamResponse:
        await allowed(request)
        name = request.match_info["name"]
        path = folder / name
        if not_a_file_name(name) or name.startswith(".") or path.is_symlink() or not path.is_file():
            raise web.HTTPNotFound(text=f"{name[:60]!r} is not one of the exported files")
        headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}", "Cache-Control": "no-store"}
        return web.FileResponse(path, headers=headers)

    router.add_get("/exports", listed)
    router.add_get("/exports/{name}", sent)


def exported_files(folder: Path) -> list[dict[str, Any]]:
    """
    Return name, size in bytes and time of change, s since the epoch, of the newest `_MOST` exported files.

    The newest file is first. The list is empty if the folder does not exist.
    """
    if not folder.is_dir():
        return []
    found: list[dict[str, Any]] = [
        {"name": path.name, "bytes": (of := path.stat()).st_size, "changed": of.st_mtime}
        for path in folder.iterdir()
        if path.is_file() and not path.is_symlink() and not path.name.startswith(".")
    ]
    return sorted(found, key=lambda one: one["changed"], reverse=True)[:_MOST]


# Listening socket of the page, and a limit on the data that a connected browser sends.


def peer_of(transport: asyncio.BaseTransport | None) -> str:
    """Return the address of the other side; empty if the connection is closed."""
    name = None if transport is None else transport.get_extra_info("peername")
    return str(name[0]) if name else ""


def listener(host: str, port: int) -> socket.socket:
    """Return a listening, non-blocking socket; raise OSError if the address cannot be opened."""
    family, _, _, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
    listener = socket.create_server(where, family=family, backlog=64)
    listener.setblocking(False)
    return listener


class QuietPeer(asyncio.Protocol):
    """
    Protocol that closes a connection when its peer sends more than `most` bytes in a minute.

    The web server gets complete messages only. A message that never ends, or frames without content, would occupy the
    web server forever. All events are passed on to the protocol that the connection had before.
    """

    def __init__(self, transport: asyncio.Transport, most: int, clock: Callable[[], float]) -> None:
        self._transport, self._most, self._clock = transport, most, clock
        self._inner: Any = transport.get_protocol()
        self._minute, self._received = clock(), 0
        transport.set_protocol(self)

    def data_received(self, data: bytes) -> None:
        """Count the bytes and pass them on."""
        now = self._clock()
        if now - self._minute > 60.0:
            self._minute, self._received = now, 0
        self._received += len(data)
        if self._received > self._most:
            self._transport.abort()
            return
        self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        """Pass on that the peer sends no more data; return whether the connection stays open for writing."""
        return bool(self._inner.eof_received())

    def connection_lost(self, error: Exception | None) -> None:
        """Tell the web server that the connection is closed."""
        self._inner.connection_lost(error)

    def pause_writing(self) -> None:
        """Tell the request handler to stop writing, because the send buffer is full (the peer reads slowly)."""
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        """Tell the request handler to continue writing, because the send buffer has room again."""
        self._inner.resume_writing()


def request_logger() -> logging.Logger:
    """Return the web server's logger, filtered so that malformed requests cannot flood the log."""
    logger = logging.getLogger("mwd.page")
    logger.addFilter(_is_own_error)
    return logger


def _is_own_error(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    return not isinstance(error, (HttpProcessingError, ConnectionError))
