# SPDX-License-Identifier: Apache-2.0
"""
Relay that lets Foxglove clients with the older protocol name connect, by changing one word of the handshake.

The server of the SDK accepts only `foxglove.sdk.v1`. Its messages are the same as those of `foxglove.websocket.v1`;
only the name of the subprotocol differs (foxglove/ros-foxglove-bridge, issue 382). The relay changes the name in the
request and back in the answer, and passes all later bytes unchanged.
"""

from __future__ import annotations

import asyncio
import re
import threading

NEW, OLD = b"foxglove.sdk.v1", b"foxglove.websocket.v1"
_HEADER = re.compile(rb"^sec-websocket-protocol:[^\r\n]*", re.IGNORECASE | re.MULTILINE)
MOST_CONNECTIONS = 32
_HANDSHAKE_S = 10.0
_CHUNK = 1 << 16


def renamed(head: bytes, old: bytes, new: bytes) -> tuple[bytes, bool]:
    """
    Change the subprotocol name in the head of a request or an answer; return the head and whether it was changed.

    A head that already has the new name is left unchanged, because that side supports it.
    """
    line = _HEADER.search(head)
    if line is None or new in line.group() or old not in line.group():
        return head, False
    return head[: line.start()] + line.group().replace(old, new) + head[line.end() :], True


class HandshakeRelay:
    """
    Relay that listens on an address and forwards connections to a server on the loopback of this machine.

    Parameters
    ----------
    host, port : str, int
        Address to listen on; port 0 selects a free port.
    inner_port : int
        Port of the server.

    Attributes
    ----------
    port : int
        Port on which the relay listens.

    Raises
    ------
    OSError
        The address cannot be opened.
    """

    def __init__(self, host: str, port: int, inner_port: int) -> None:
        self._inner_port = inner_port
        self._connections: set[asyncio.Task[None]] = set()
        self._loop = asyncio.new_event_loop()
        try:
            server = self._loop.run_until_complete(asyncio.start_server(self._relay, host, port))
        except OSError:
            self._loop.close()
            raise
        self.port = int(server.sockets[0].getsockname()[1])
        self._server = server
        self._thread = threading.Thread(target=self._run, name="foxglove-relay", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close all connections."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(timeout=2.0)

    def _run(self) -> None:
        self._loop.run_forever()
        self._loop.run_until_complete(self._close())
        self._loop.close()

    async def _close(self) -> None:
        self._server.close()
        for task in self._connections:
            task.cancel()
        await asyncio.gather(*self._connections, return_exceptions=True)

    async def _relay(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if task is None:
            raise RuntimeError("a connection is served in a task of the loop")
        if len(self._connections) >= MOST_CONNECTIONS:
            # Each connection costs two file handles, which page and recorder need too.
            writer.close()
            return
        self._connections.add(task)
        inner: asyncio.StreamWriter | None = None
        try:
            async with asyncio.timeout(_HANDSHAKE_S):
                request, old = renamed(await reader.readuntil(b"\r\n\r\n"), OLD, NEW)
                answers, inner = await asyncio.open_connection("127.0.0.1", self._inner_port)
                inner.write(request)
                answer = await answers.readuntil(b"\r\n\r\n")
            writer.write(renamed(answer, NEW, OLD)[0] if old else answer)
            ways = [asyncio.ensure_future(_pass(*way)) for way in ((reader, inner), (answers, writer))]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)
        except (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            # There was no handshake, or the other side has gone, so no answer can be sent.
            return
        finally:
            for one in (writer, inner):
                if one is not None:
                    one.close()
            self._connections.discard(task)


async def _pass(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Forward bytes until the end; a slow reader blocks the sender, so that the server drops its oldest messages."""
    while data := await reader.read(_CHUNK):
        writer.write(data)
        await writer.drain()
