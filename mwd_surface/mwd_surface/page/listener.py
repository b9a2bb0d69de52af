# SPDX-License-Identifier: Apache-2.0
"""The listening socket of the page, with errors that name the port."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket

from aiohttp.http_exceptions import HttpProcessingError


def peer_of(transport: asyncio.BaseTransport | None) -> str:
    """Address of the other side; empty where it is gone."""
    name = None if transport is None else transport.get_extra_info("peername")
    return str(name[0]) if name else ""


def listener(host: str, port: int) -> socket.socket:
    """Listening socket that does not block; OSError where the address is not to be had."""
    family, _, _, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
    listener = socket.create_server(where[:2], family=family, backlog=64)
    listener.setblocking(False)
    return listener


def port_error(error: OSError, host: str, port: int) -> OSError:
    """The error again, with what to do about it."""
    if error.errno == errno.EADDRINUSE:
        why = "is taken by another program; end that one or set another port (0: any that is free)"
    elif error.errno == errno.EACCES:
        why = "is not allowed to this user; take one above 1023"
    elif error.errno == errno.EADDRNOTAVAIL:
        why = "is on an address this machine does not have"
    else:
        why = f"cannot be opened: {error.strerror or error}"
    return OSError(error.errno or 0, f"page: port {port} on {host} {why}")


def request_logger() -> logging.Logger:
    """Logger of the web server; requests that are none, which anybody can send without end, leave no line in it."""
    logger = logging.getLogger("mwd.page")
    logger.addFilter(_is_own_error)
    return logger


def _is_own_error(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    return not isinstance(error, (HttpProcessingError, ConnectionError))
