# SPDX-License-Identifier: Apache-2.0
"""
Base of all rig interfaces: start, accept values without blocking the caller, report the state, and stop.

An interface runs an event loop in its own thread. It may return rig data or a command through callbacks, which are
called in that thread.
"""

from __future__ import annotations

import abc
import asyncio
import concurrent.futures
import contextlib
import dataclasses
import importlib
import importlib.metadata
import logging
import random
import socket
import sys
import threading
import time
from collections.abc import Callable
from types import ModuleType
from typing import Any

from mwd_sensors.core.arrays import Samples
from mwd_sensors.core.foreign_text import printable
from mwd_sensors.core.settings import setting
from mwd_surface.loopback import port_problem, refused_host
from mwd_surface.rig.values import RigValues

OnRigState = Callable[[Samples], None]
OnCommand = Callable[[str, dict[str, Any]], tuple[bool, str]]
LISTENING, CONNECTED, CONNECTING, DOWN, STOPPED = "listening", "connected", "connecting", "down", "stopped"


class InterfaceError(RuntimeError):
    """Raised if an interface cannot run; the message says why and what to do."""


@dataclasses.dataclass(frozen=True)
class PeerStatus:
    """State of one connection."""

    address: str
    since: float  #: steady time at which the connection began, s
    #: `sent`, `received`, `dropped`: numbers of messages since then.
    sent: int = 0
    received: int = 0
    dropped: int = 0
    rate: float = 0.0  #: messages sent per second
    last: str = ""  #: text of the last message


@dataclasses.dataclass(frozen=True)
class InterfaceStatus:
    """State of one interface: a word such as LISTENING, its address, and the reason if it is not running."""

    name: str
    state: str
    address: str = ""
    reason: str = ""
    peers: tuple[PeerStatus, ...] = ()
    #: `sent`, `received`: numbers of messages.
    sent: int = 0
    received: int = 0
    dropped: int = 0  #: number of messages not delivered to a slow peer
    refused: int = 0  #: number of refused connections
    counts: tuple[tuple[str, int], ...] = ()  #: further counters by name
    last: tuple[tuple[str, str], ...] = ()  #: names and texts of the last values sent


class RigInterface(abc.ABC):
    """
    One interface that sends values to the rig, and may receive data from it; its work is a coroutine in its own thread.

    Subclasses implement `serve(ready, stop)`, which calls `ready(address)` as soon as it serves, and returns when
    `stop` is set. `wake` is set whenever `values` has new values, and when the interface must stop. `failure` is the
    reason why the interface ended by itself; otherwise empty.
    """

    start_timeout = 30.0

    def __init__(self, name: str) -> None:
        self.name = name
        self.values: RigValues | None = None
        self.address = self.failure = ""
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop: asyncio.Event | None = None
        self._wake: asyncio.Event | None = None
        self._started: concurrent.futures.Future[str] = concurrent.futures.Future()

    @abc.abstractmethod
    async def serve(self, ready: Callable[[str], None], stop: asyncio.Event) -> None:
        """Serve the interface until `stop` is set; call `ready` with the address as soon as it serves."""

    @abc.abstractmethod
    def status(self) -> InterfaceStatus:
        """Return the state; may be called from any thread."""

    @property
    def port(self) -> int:
        """Port on which a server listens; 0 while it is not running."""
        return int(self.address.rpartition(":")[2].rstrip("/")) if self.address else 0

    @property
    def wake(self) -> asyncio.Event:
        """
        Event that is set when new values arrive and when the interface must stop; the coroutine clears the event.

        Raises RuntimeError before the first start.
        """
        if self._wake is None:
            raise RuntimeError(f"{self.name} is not running")
        return self._wake

    @property
    def running(self) -> bool:
        """Whether the interface has started and has not stopped or failed since."""
        return self._thread is not None and self._thread.is_alive() and bool(self.address)

    def start(self) -> None:
        """
        Start the thread and wait until the interface serves or fails.

        Raises
        ------
        InterfaceError
            The interface runs already, or does not serve within `start_timeout`; a package is missing, or the port or
            device cannot be opened.
        """
        if self._thread is not None and self._thread.is_alive():
            raise InterfaceError(f"{self.name} is running already")
        self.failure = self.address = ""
        self._started = concurrent.futures.Future()
        self._thread = threading.Thread(target=self._run, name=f"rig-{self.name}", daemon=True)
        self._thread.start()
        try:
            self.address = self._started.result(timeout=self.start_timeout)
        except TimeoutError as error:
            self.stop()
            raise InterfaceError(f"{self.name} did not start within {self.start_timeout:.0f} s") from error
        except InterfaceError:
            self._thread.join(timeout=1.0)
            self._thread = None
            raise

    def publish(self, values: RigValues) -> None:
        """Store the newest values, in place of values that still wait, and wake the coroutine; never blocks."""
        self.values = values
        self.rouse()

    def rouse(self) -> None:
        """Wake the coroutine, from any thread; does nothing if it is not running."""
        self._set(self._wake)

    def _set(self, event: asyncio.Event | None) -> None:
        loop = self._loop
        if loop is not None and event is not None:
            # If the loop closed just before this call, nothing waits for the event.
            with contextlib.suppress(RuntimeError):
                loop.call_soon_threadsafe(event.set)

    async def woken(self, seconds: float | None) -> None:
        """Wait until `wake` is set, at most for a time, s, and clear it."""
        await wait_for(self.wake, seconds)
        self.wake.clear()

    def stop(self) -> None:
        """Ask the coroutine to end and wait for the thread, at most two seconds; no effect if it is not running."""
        thread, self._thread, self.address = self._thread, None, ""
        if thread is not None:
            self._set(self._stop)
            self._set(self._wake)
            thread.join(timeout=2.0)

    def _run(self) -> None:
        try:
            asyncio.run(self._main())
        except Exception as error:  # noqa: BLE001  (any error is the reason that the status shows)
            words = str(error) if isinstance(error, (OSError, ValueError)) else f"{type(error).__name__}: {error}"
            failure = error if isinstance(error, InterfaceError) else InterfaceError(f"{self.name}: {words}")
            if self._started.done():
                self.failure = str(failure)
            else:
                self._started.set_exception(failure)
        finally:
            self._loop = None
            if not self._started.done():
                self._started.set_exception(InterfaceError(f"{self.name} ended before it served"))

    async def _main(self) -> None:
        self._loop, self._stop, self._wake = asyncio.get_running_loop(), asyncio.Event(), asyncio.Event()
        await self.serve(self._ready, self._stop)

    def _ready(self, address: str) -> None:
        if not self._started.done():
            self._started.set_result(address)


async def wait_for(event: asyncio.Event, seconds: float | None) -> None:
    """Wait until an event is set, at most for a time, s; None: without end."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            await event.wait()


def optional(module: str, package: str, what: str, floor: tuple[int, int] = (0, 0)) -> ModuleType:
    """
    Return a module of an optional package, if the package has at least version `floor` (major, minor).

    what: name of the feature that needs the package, for messages.

    Raises
    ------
    InterfaceError
        The package is not installed or too old; the message gives the command that installs it.
    """
    least = ".".join(map(str, floor))
    try:
        installed = importlib.metadata.version(package) if any(floor) else least
        if tuple(int(part) for part in installed.split(".")[:2]) < floor:
            raise InterfaceError(
                f"{what} needs {package} {least} or later, and {installed} is installed:"
                f" pip install '{package}>={least}'"
            )
        return importlib.import_module(module)
    except ImportError as error:
        raise InterfaceError(
            f"{what} needs the package {package}, which is not installed: pip install {package}"
        ) from error


def checked_host(host: str, allow_network: bool) -> str:
    """
    Return the address to listen on, after checking that it is allowed.

    Raises
    ------
    InterfaceError
        The text is not an address, or other machines can reach the address and the settings do not allow this.
    """
    if why := refused_host(host, allow_network=allow_network):
        raise InterfaceError(why)
    return host


def probe_port(host: str, port: int) -> None:
    """
    Open and close a port, to find the cause if it cannot be opened: the server library does not report the cause.

    Raises
    ------
    InterfaceError
        The port cannot be opened; the message gives the reason.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        raise port_error(error, host, port) from error


def port_error(error: OSError, host: str, port: int) -> InterfaceError:
    """Return the error for a port that cannot be opened."""
    return InterfaceError(port_problem(error, host, port))


# Waits between attempts to connect.


@dataclasses.dataclass(frozen=True)
class Backoff:
    """Waiting times between attempts: doubled after each failure, up to the longest."""

    first: float = setting(
        1.0,
        "Wait before the second attempt to connect. The wait doubles with each further failure. Each wait is "
        "multiplied by a random factor of 0.5 to 1.",
        unit="s",
        low=0.01,
        high=600.0,
    )
    longest: float = setting(
        30.0,
        "Longest wait between two attempts to connect. Raising it causes less traffic, but a peer that returns is "
        "found later.",
        unit="s",
        low=0.01,
        high=3600.0,
    )

    def wait(self, failures: int) -> float:
        """
        Return the wait before the next attempt, s, after a number of consecutive failures, 1 or more.

        The wait has a random factor, so that several units do not retry at the same time.
        """
        share = random.uniform(0.5, 1.0)  # noqa: S311 (spreads waits; nothing secret)
        return float(min(self.longest, self.first * 2.0 ** min(failures - 1, 30)) * share)


# Log of the libraries that serve network peers, bounded in length and rate. asyncua and pymodbus log every malformed
# message with its bytes and a traceback. A peer that sends junk could fill the log with any contents, and hide the
# other messages.

_MOST, _PERIOD_S = 10, 60.0  # largest number of lines in a period, and the period, s
_LONGEST = 200  # largest number of characters in a line


class LibraryLog(logging.Handler):
    """
    Handler that writes the first line of each record, at most ten lines a minute, and the number of omitted records.

    Parameters
    ----------
    write : callable
        Called with one line.
    clock : callable
        Steady time, s.
    """

    def __init__(
        self, write: Callable[[str], object] | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(logging.WARNING)
        self._write = write or (lambda line: sys.stderr.write(line + "\n"))
        self._clock = clock
        self._since = -_PERIOD_S
        self._lines = self._left_out = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record, or only count it if the period already has its largest number of lines."""
        now = self._clock()
        if now - self._since >= _PERIOD_S:
            if self._left_out:
                self._write(f"{record.name}: {self._left_out} more messages were left out")
            self._since, self._lines, self._left_out = now, 0, 0
        if self._lines >= _MOST:
            self._left_out += 1
            return
        self._lines += 1
        text = record.getMessage().strip().partition("\n")[0]
        error = record.exc_info[1] if record.exc_info else None
        kind = f" ({type(error).__name__})" if error is not None else ""
        self._write(printable(f"{record.name}: {text[:_LONGEST]}{kind}"))


def bound_log(library: str) -> None:
    """Limit length and rate of the log of a library; does nothing if the log is limited already."""
    logger = logging.getLogger(library)
    if not any(isinstance(handler, LibraryLog) for handler in logger.handlers):
        logger.addHandler(LibraryLog())
