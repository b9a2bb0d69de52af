"""
Serves the driller's page and pushes the state to every browser; one thread with its own event loop.

Each client gets what changed since the last thing it got, at a bounded rate: a slow one skips states instead of
queueing them, so memory does not grow. The page is read-only; commands need a token and go to a callback.

Guarded against the open web: loopback unless told otherwise, Host and Origin checked (a name that is not ours may be a
rebound one), a content policy without any other source, limits on size, time and number of connections.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import dataclasses
import errno
import hmac
import ipaddress
import json
import math
import mimetypes
import socket
import threading
import time
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web

from mwd_sensors.core.settings import setting
from mwd_surface.loopback import is_loopback

Command = Callable[[str, dict[str, Any]], tuple[bool, str]]
PAGE = Path(__file__).parent / "static"

# Commands, and of each argument: its type and whether it may be left out.
COMMANDS: dict[str, dict[str, tuple[type, bool]]] = {
    "accept_survey": {
        "sequence": (int, False),
        "operator_name": (str, False),
        "reason": (str, True),
        "measured_depth": (float, True),
        "replace": (bool, True),
    },
    "reject_survey": {"sequence": (int, False), "operator_name": (str, False), "reason": (str, True)},
    "set_depth": {"bit_depth": (float, False), "operator_name": (str, False)},
    "take_survey": {"duration": (float, True)},
    "acknowledge_alarm": {"id": (str, False), "operator_name": (str, False)},
    "start_recording": {"name": (str, True)},
    "stop_recording": {},
    "split_recording": {},
    "snapshot_recording": {},
    "export": {"format": (str, False), "name": (str, True)},
}
# Sections that grow by rows: a client gets the new ones.
_STRIPS = ("history", "depth_log")
_MAX_TEXT = 500
# A sign of life at least so often, s.
_BEAT = 1.0
_MAX_BODY = 16 * 1024
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
_BUSY = b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 5\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"


@dataclasses.dataclass(frozen=True)
class PageSettings:
    """Where the page is, who may ask for it, and how much it may cost."""

    host: str = setting("127.0.0.1", "address to listen on", fixed=True)
    port: int = setting(8080, "TCP port; 0: any that is free", low=0, high=65535, fixed=True)
    allow_network: bool = setting(False, "listen on an address that other machines can reach", fixed=True)
    allowed_hosts: tuple[str, ...] = setting((), "further host names the page may be called by", fixed=True)
    token: str = setting("", "secret that operator controls ask for; empty: no controls", fixed=True)
    max_rate: float = setting(15.0, "states sent to one browser per second", unit="Hz", low=0.5, high=20.0, fixed=True)
    max_clients: int = setting(32, "browsers that watch at a time", low=1, high=500, fixed=True)
    max_connections: int = setting(96, "connections at a time", low=4, high=1000, fixed=True)
    max_per_peer: int = setting(64, "connections at a time from one address", low=2, high=1000, fixed=True)
    request_timeout: float = setting(5.0, "time to send a request", unit="s", low=0.1, high=60.0, fixed=True)
    command_timeout: float = setting(
        15.0, "longest wait for the answer to a command", unit="s", low=0.5, high=120.0, fixed=True
    )
    send_timeout: float = setting(
        10.0, "a browser that takes no byte for so long is dropped", unit="s", low=0.2, high=120.0, fixed=True
    )


class PageServer:
    """
    The page of one well.

    Parameters
    ----------
    settings : PageSettings
    on_command : callable, optional
        `on_command(name, arguments) -> (ok, message)`, called in a thread of the server, one at a time; arguments are
        checked against `COMMANDS`. None, or an empty token: read-only.
    clock : callable
        Steady seconds, the clock of the snapshots' `now`.
    page : Path
        Folder of the page's files; they are read once, at start.

    Raises
    ------
    ValueError
        The address is not loopback and `allow_network` is not set, or the token is too short to be a secret.
    """

    def __init__(
        self,
        settings: PageSettings | None = None,
        on_command: Command | None = None,
        clock: Callable[[], float] = time.monotonic,
        page: Path = PAGE,
    ) -> None:
        self.settings = settings or PageSettings()
        if not self.settings.allow_network and not is_loopback(self.settings.host):
            raise ValueError(
                f"host: {self.settings.host} can be reached from other machines; set allow_network if that is meant"
            )
        if 0 < len(self.settings.token) < 8:
            raise ValueError("token: a secret needs at least 8 characters")
        self.skipped = 0
        self.refused = 0
        self._on_command = on_command if self.settings.token else None
        self._clock = clock
        self._page = page
        self._snapshot: Mapping[str, Any] | None = None
        self._texts: dict[str, tuple[int, str]] = {}
        self._clients: set[_Client] = set()
        self._silent: set[Any] = set()
        self._executor: concurrent.futures.ThreadPoolExecutor | None = None
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop: asyncio.Event | None = None
        self._started: concurrent.futures.Future[tuple[str, int]] = concurrent.futures.Future()
        self._address: tuple[str, int] | None = None

    @property
    def address(self) -> str:
        """
        `http://host:port/` of the running page.

        Raises
        ------
        RuntimeError
            It is not running.
        """
        if self._address is None:
            raise RuntimeError("the page is not running; call start first")
        host, port = self._address
        return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"

    @property
    def clients(self) -> int:
        """Browsers that watch now."""
        return len(self._clients)

    def push(self, snapshot: Mapping[str, Any]) -> None:
        """
        A new state (`LiveState.snapshot`), from any thread; the last one wins.

        The snapshot is not copied: nobody may change it afterwards.
        """
        self._snapshot = snapshot
        loop = self._loop
        if loop is not None and self._clients:
            try:
                loop.call_soon_threadsafe(self._wake)
            except RuntimeError:
                # The loop closed between the two lines: there is nobody left to tell.
                return

    def start(self) -> None:
        """
        Listen and serve until `stop`.

        Raises
        ------
        OSError
            The port is taken or not allowed; the message names it.
        RuntimeError
            It is running already.
        """
        if self._thread is not None:
            raise RuntimeError("the page is running already")
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
        """Close all connections and end the thread, within a second; nothing happens if it is not running."""
        thread, loop, stop = self._thread, self._loop, self._stop
        self._thread, self._address = None, None
        if thread is None or loop is None or stop is None:
            return
        loop.call_soon_threadsafe(stop.set)
        thread.join(timeout=1.0)

    # In the thread.

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
        application = web.Application(middlewares=[self._guard], client_max_size=_MAX_BODY)
        files = await asyncio.to_thread(_files, self._page)
        for name, (body, kind) in files.items():
            application.router.add_get("/" + name, _sender(body, kind))
        application.router.add_get("/", _sender(*files["index.html"]))
        application.router.add_get("/state.json", self._state)
        application.router.add_get("/live", self._live)
        application.router.add_post("/command/{name}", self._command)
        runner = web.AppRunner(application, access_log=None, shutdown_timeout=0.2, keepalive_timeout=5.0)
        await runner.setup()
        server = runner.server
        if server is None:
            raise OSError("the web server did not start")
        executor = self._executor = concurrent.futures.ThreadPoolExecutor(1, "page-command")
        host, port = self.settings.host, self.settings.port
        try:
            listener = await asyncio.to_thread(_listener, host, port)
        except OSError as error:
            await runner.cleanup()
            executor.shutdown(wait=False)
            raise _port_error(error, host, port) from error
        bound = listener.getsockname()
        self._started.set_result((bound[0], bound[1]))
        door = asyncio.create_task(self._accept(listener, server))
        await self._stop.wait()
        door.cancel()
        listener.close()
        goodbyes = [client.talk.close(code=1001, message=b"the page ends") for client in self._clients]
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(asyncio.gather(*goodbyes, return_exceptions=True), 0.3)
        await runner.cleanup()
        executor.shutdown(wait=False, cancel_futures=True)

    async def _accept(self, listener: socket.socket, server: web.Server) -> None:
        """Let connections in, not too many; each must make a whole request in time or go."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                door, peer = await loop.sock_accept(listener)
            except OSError:
                # Out of file handles, or the other side has gone already: the next one may do better.
                await asyncio.sleep(0.05)
                continue
            there = [_peer(handler.transport) for handler in server.connections]
            if len(there) >= self.settings.max_connections or there.count(peer[0]) >= self.settings.max_per_peer:
                self.refused += 1
                with contextlib.suppress(OSError):
                    door.send(_BUSY)
                door.close()
                continue
            try:
                _, protocol = await loop.connect_accepted_socket(server, door)
            except OSError:
                door.close()
                continue
            self._silent.add(protocol)
            loop.call_later(self.settings.request_timeout, self._expire, protocol)

    def _expire(self, protocol: Any) -> None:
        if protocol in self._silent and protocol.transport is not None:
            protocol.transport.abort()
        self._silent.discard(protocol)

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        self._silent.discard(request.protocol)
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
            # One request each: an idle connection then cannot hold a place.
            response.force_close()
        return response

    def _check_origin(self, request: web.Request) -> None:
        host = request.headers.get("Host", "")
        if not self._is_ours(host):
            raise web.HTTPMisdirectedRequest(text=f"host {host[:100]!r} is not one this page is called by")
        origin = request.headers.get("Origin")
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            raise web.HTTPForbidden(text="this page does not answer other sites")

    def _is_ours(self, host: str) -> bool:
        # An address cannot be rebound to another machine, a foreign name can.
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
            text=self._message({}, {}, 0, cached=False)[0],
            content_type="application/json",
            headers={"Cache-Control": "no-store"},
        )

    async def _live(self, request: web.Request) -> web.StreamResponse:
        if request.headers.get("Upgrade", "").lower() != "websocket":
            raise web.HTTPUpgradeRequired(text="this address speaks WebSocket; /state.json is plain")
        if request.headers.get("Origin") is None and request.headers.get("Sec-Fetch-Site") not in (None, "same-origin"):
            raise web.HTTPForbidden(text="this page does not answer other sites")
        if len(self._clients) >= self.settings.max_clients:
            self.refused += 1
            raise web.HTTPServiceUnavailable(text=f"{self.settings.max_clients} browsers are watching already")
        talk = web.WebSocketResponse(max_msg_size=1024, heartbeat=20.0, timeout=0.2, compress=False)
        await talk.prepare(request)
        if request.transport is None:
            return talk
        client = _Client(talk, request.transport)
        self._clients.add(client)
        sender = asyncio.create_task(self._feed(client))
        try:
            async for message in talk:
                # Nothing is expected from a browser; what is not a control frame ends the talk.
                if message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                    break
        finally:
            self._clients.discard(client)
            # Closed first: in Python 3.11 a wait that ends as it is cancelled swallows the cancellation, and the sender
            # would go on; a closed talk ends it all the same.
            await talk.close()
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)
        return talk

    async def _feed(self, client: _Client) -> None:
        """Send what is new, not more often than allowed, and a beat at least once a second."""
        period = 1.0 / self.settings.max_rate
        while not client.talk.closed:
            client.wake.clear()
            started = self._clock()
            text, revisions, strips, news = self._message(client.revisions, client.strips, client.skipped)
            if news or started - client.sent >= _BEAT:
                before = self._snapshot
                try:
                    await asyncio.wait_for(client.talk.send_str(text), self.settings.send_timeout)
                except (TimeoutError, ConnectionError):
                    # Nothing taken for too long: the browser comes back by itself when it can.
                    client.transport.abort()
                    return
                client.revisions, client.strips, client.sent = revisions, strips, started
                if self._clock() - started > 2.0 * period and self._snapshot is not before:
                    client.skipped += 1
                    self.skipped += 1
            await asyncio.sleep(max(0.0, period - (self._clock() - started)))
            try:
                await asyncio.wait_for(client.wake.wait(), max(0.05, client.sent + _BEAT - self._clock()))
            except TimeoutError:
                continue

    def _wake(self) -> None:
        for client in self._clients:
            client.wake.set()

    def _message(
        self, revisions: Mapping[str, int], strips: Mapping[str, float], skipped: int, cached: bool = True
    ) -> tuple[str, dict[str, int], dict[str, float], bool]:
        """
        Text with all sections whose revision is not in `revisions`, what the client then has, and if it is news.

        strips : of the sections that grow by rows, the first column of the last row the client has.
        """
        snapshot = self._snapshot
        own = {
            "controls": self._on_command is not None,
            "clients": len(self._clients),
            "skipped": skipped,
            "ready": snapshot is not None,
        }
        head = f'{{"now": {self._clock():.3f}, "server": {json.dumps(own)}, "sections": {{'
        if snapshot is None:
            return head + "}}", {}, {}, False
        parts, now_has = [], snapshot["revisions"]
        for name, section in snapshot["sections"].items():
            if revisions.get(name) == now_has[name]:
                continue
            if name in _STRIPS:
                last = strips.get(name)
                rows = [row for row in section["rows"] if last is None or row[0] > last]
                fresh = {"columns": section["columns"], "rows": rows, "whole": last is None}
                parts.append(f"{json.dumps(name)}: {_dumps(fresh)}")
                strips = {**strips, name: rows[-1][0]} if rows else strips
            else:
                # What is kept for all clients has the ages of its first sending; those who can compute use `at`.
                text = self._text(name, now_has[name], section) if cached else _dumps(section)
                parts.append(f"{json.dumps(name)}: {text}")
        return head + ", ".join(parts) + "}}", dict(now_has), dict(strips), bool(parts)

    def _text(self, name: str, revision: int, section: Any) -> str:
        """JSON of a section, made once for all clients."""
        known = self._texts.get(name)
        if known is None or known[0] != revision:
            known = self._texts[name] = (revision, _dumps(section))
        return known[1]

    async def _command(self, request: web.Request) -> web.StreamResponse:
        if self._on_command is None:
            raise web.HTTPForbidden(text="this page is read-only: no token is configured")
        kind, _, given = request.headers.get("Authorization", "").partition(" ")
        if kind != "Bearer" or not hmac.compare_digest(given.encode(), self.settings.token.encode()):
            # Slows guessing down without blocking anybody else.
            await asyncio.sleep(0.3)
            raise web.HTTPUnauthorized(text="the token is missing or wrong")
        name = request.match_info["name"]
        if name not in COMMANDS:
            raise web.HTTPNotFound(text=f"no such command: {name[:60]!r}; there are {', '.join(COMMANDS)}")
        if request.content_type != "application/json":
            raise web.HTTPUnsupportedMediaType(text="send application/json")
        try:
            body = await asyncio.wait_for(request.read(), self.settings.request_timeout)
        except TimeoutError:
            raise web.HTTPRequestTimeout(text="the request did not arrive in time") from None
        arguments = checked_arguments(name, body)
        work = asyncio.get_running_loop().run_in_executor(self._executor, self._on_command, name, arguments)
        try:
            ok, message = await asyncio.wait_for(work, self.settings.command_timeout)
        except ValueError as error:
            ok, message = False, str(error)
        except TimeoutError:
            raise web.HTTPGatewayTimeout(text=f"{name} is still at work; the event log will tell") from None
        return _json({"ok": ok, "message": message}, 200 if ok else 409)


class _Client:
    """One browser and what it has seen."""

    def __init__(self, talk: web.WebSocketResponse, transport: asyncio.Transport) -> None:
        self.talk = talk
        self.transport = transport
        self.sent = -_BEAT
        self.wake = asyncio.Event()
        self.revisions: dict[str, int] = {}
        self.strips: dict[str, float] = {}
        self.skipped = 0


def checked_arguments(command: str, body: bytes) -> dict[str, Any]:
    """
    Arguments of a command from a request's body.

    Raises
    ------
    web.HTTPBadRequest
        Not JSON, or a field is missing, unknown, of another type, not finite or too long; the text names it.
    """
    try:
        given = json.loads(body.decode() or "{}", parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise web.HTTPBadRequest(text=f"the body is not JSON: {str(error)[:200]}") from None
    if not isinstance(given, dict):
        raise web.HTTPBadRequest(text="the body must be a JSON object")
    fields = COMMANDS[command]
    for name in given:
        if name not in fields:
            raise web.HTTPBadRequest(text=f"{name[:60]}: {command} takes {', '.join(fields) or 'no arguments'}")
    arguments: dict[str, Any] = {}
    for name, (kind, optional) in fields.items():
        if name not in given:
            if optional:
                continue
            raise web.HTTPBadRequest(text=f"{name}: must be given")
        arguments[name] = _argument(name, given[name], kind)
    if "operator_name" in fields and not arguments["operator_name"].strip():
        raise web.HTTPBadRequest(text="operator_name: must not be empty: the log says who did it")
    return arguments


def _argument(name: str, value: Any, kind: type) -> Any:
    if kind is float and type(value) is int and abs(value) < 2**53:
        value = float(value)
    if type(value) is not kind:
        raise web.HTTPBadRequest(text=f"{name}: expected {kind.__name__}, got {type(value).__name__}")
    if isinstance(value, float) and not math.isfinite(value):
        raise web.HTTPBadRequest(text=f"{name}: must be finite")
    if isinstance(value, str) and (len(value) > _MAX_TEXT or any(ord(c) < 32 for c in value)):
        raise web.HTTPBadRequest(text=f"{name}: at most {_MAX_TEXT} characters on one line")
    if type(value) is int and not 0 <= value < 2**32:
        raise web.HTTPBadRequest(text=f"{name}: must be within 0 and {2**32 - 1}")
    return value


def _refuse_constant(word: str) -> Any:
    raise ValueError(f"{word} is not a number")


def _dumps(table: Any) -> str:
    return json.dumps(table, allow_nan=False, separators=(",", ":"))


def _json(table: Mapping[str, Any], status: int) -> web.Response:
    return web.Response(text=_dumps(table), status=status, content_type="application/json")


def _files(folder: Path) -> dict[str, tuple[bytes, str]]:
    """All files of the page by their address; nothing else can be asked for."""
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


def _sender(body: bytes, kind: str) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
    async def send(_request: web.Request) -> web.StreamResponse:
        charset = "utf-8" if kind.startswith("text/") else None
        return web.Response(body=body, content_type=kind, charset=charset, headers={"Cache-Control": "no-cache"})

    return send


def _peer(transport: asyncio.BaseTransport | None) -> str:
    name = None if transport is None else transport.get_extra_info("peername")
    return str(name[0]) if name else ""


def _listener(host: str, port: int) -> socket.socket:
    family, _, _, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
    listener = socket.create_server(where[:2], family=family, backlog=64)
    listener.setblocking(False)
    return listener


def _port_error(error: OSError, host: str, port: int) -> OSError:
    if error.errno == errno.EADDRINUSE:
        why = "is taken by another program; end that one or set another port (0: any that is free)"
    elif error.errno == errno.EACCES:
        why = "is not allowed to this user; take one above 1023"
    elif error.errno == errno.EADDRNOTAVAIL:
        why = "is on an address this machine does not have"
    else:
        why = f"cannot be opened: {error.strerror or error}"
    return OSError(error.errno or 0, f"page: port {port} on {host} {why}")
