# SPDX-License-Identifier: Apache-2.0
"""Listening socket of the page."""

from __future__ import annotations

import asyncio
import logging
import socket

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


def request_logger() -> logging.Logger:
    """Return the web server's logger, filtered so that malformed requests cannot flood the log."""
    logger = logging.getLogger("mwd.page")
    logger.addFilter(_is_own_error)
    return logger


def _is_own_error(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    return not isinstance(error, (HttpProcessingError, ConnectionError))
