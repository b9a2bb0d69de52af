# SPDX-License-Identifier: Apache-2.0
"""Listening socket of the page, and a limit on what a watching browser sends."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable
from typing import Any

from aiohttp.http_exceptions import HttpProcessingError


def peer_of(transport: asyncio.BaseTransport | None) -> str:
    """Return the address of the other side; empty if the connection is gone."""
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

    The web server sees complete messages only. A message that never ends, or frames without content, would occupy it
    for good. All events are passed on to the protocol that the connection had before.
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
        """Pass on that the peer has ended."""
        return bool(self._inner.eof_received())

    def connection_lost(self, error: Exception | None) -> None:
        """Pass on that the connection is gone."""
        self._inner.connection_lost(error)

    def pause_writing(self) -> None:
        """Pass on that the peer reads slowly."""
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        """Pass on that the peer reads again."""
        self._inner.resume_writing()


def request_logger() -> logging.Logger:
    """Return the web server's logger, filtered so that malformed requests cannot flood the log."""
    logger = logging.getLogger("mwd.page")
    logger.addFilter(_is_own_error)
    return logger


def _is_own_error(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    return not isinstance(error, (HttpProcessingError, ConnectionError))
