# SPDX-License-Identifier: Apache-2.0
"""
Sender of the page's state to its clients: each client gets the changes since its last message, at a bounded rate.

A slow client skips states instead of queueing them, so memory does not grow and the client does not show old states.
Each state is followed by a ping, which a browser answers after it has read the state, and only a few states may be
unanswered at a time.
"""

from __future__ import annotations

import asyncio
import dataclasses
import json
from collections.abc import Callable, Mapping
from typing import Any

from aiohttp import web

from mwd_surface.page.state_json import STRIPS

_HEARTBEAT = 1.0  # longest time between two messages to a client, s
_ON_THE_WAY = 4  # largest number of unanswered states; at 15 Hz a round trip of a quarter of a second costs no update


@dataclasses.dataclass(frozen=True)
class Seen:
    """State known to a client: section revisions, and the first column of the last row of each growing section."""

    revisions: Mapping[str, int] = dataclasses.field(default_factory=dict)
    strips: Mapping[str, float] = dataclasses.field(default_factory=dict)


class Client:
    """One browser, and the state known to it."""

    def __init__(self, socket: web.WebSocketResponse, transport: asyncio.Transport) -> None:
        self.socket = socket
        self.transport = transport
        self.sent = -_HEARTBEAT
        self.wake = asyncio.Event()
        self.seen = Seen()
        self.skipped = 0
        self.on_the_way = 0
        self.may_send = asyncio.Event()
        self.may_send.set()

    def sent_one(self) -> None:
        """Count a sent state; `may_send` is cleared while `_ON_THE_WAY` states are unanswered."""
        self.on_the_way += 1
        if self.on_the_way >= _ON_THE_WAY:
            self.may_send.clear()

    def answered(self) -> None:
        """Process the answer to the ping after a state: the client has read that state."""
        self.on_the_way = max(0, self.on_the_way - 1)
        self.may_send.set()


class StateFeed:
    """
    Feed of the present state of the well (snapshot) to the clients.

    Parameters
    ----------
    period : float
        Shortest time between two messages to a client, s.
    send_timeout : float
        Time, s, after which a client that accepts no data is dropped.
    clock : callable
        Steady time, s.
    now : callable
        Function that returns the present time by the clock of the times in the snapshots, s; by default `clock`.
    """

    def __init__(
        self, period: float, send_timeout: float, clock: Callable[[], float], now: Callable[[], float] | None = None
    ) -> None:
        self.snapshot: Mapping[str, Any] | None = None
        self.clients: set[Client] = set()
        # Data about the server itself: whether it accepts commands, and the export formats.
        self.own: dict[str, Any] = {"controls": False, "exports": []}
        self.skipped = 0
        self._period, self._send_timeout, self._clock = period, send_timeout, clock
        self._now = now or clock
        self._texts: dict[str, tuple[int, str]] = {}

    async def send(self, client: Client) -> None:
        """
        Send new states to a client at the allowed rate, or a heartbeat each second, until the client disconnects.

        A client that accepts or answers nothing for `send_timeout` is disconnected.
        """
        period = self._period
        while not client.socket.closed:
            if not client.may_send.is_set():
                before = self.snapshot
                try:
                    await asyncio.wait_for(client.may_send.wait(), self._send_timeout)
                except TimeoutError:
                    # Nothing was read for too long; the browser reconnects when it can.
                    client.transport.abort()
                    return
                if self.snapshot is not before:
                    client.skipped += 1
                    self.skipped += 1
            client.wake.clear()
            started = self._clock()
            text, seen, news = self.message(client.seen, client.skipped)
            if news or started - client.sent >= _HEARTBEAT:
                before = self.snapshot
                client.sent_one()
                try:
                    await asyncio.wait_for(_sent(client.socket, text), self._send_timeout)
                except (TimeoutError, ConnectionError):
                    # No data was accepted for too long; the browser reconnects when it can.
                    client.transport.abort()
                    return
                client.seen, client.sent = seen, started
                if self._clock() - started > 2.0 * period and self.snapshot is not before:
                    client.skipped += 1
                    self.skipped += 1
            await asyncio.sleep(max(0.0, period - (self._clock() - started)))
            try:
                await asyncio.wait_for(client.wake.wait(), max(0.05, client.sent + _HEARTBEAT - self._clock()))
            except TimeoutError:
                continue

    def wake(self) -> None:
        """Wake the senders of all clients for a new snapshot."""
        for client in self.clients:
            client.wake.set()

    def message(self, seen: Seen, skipped: int, *, cached: bool = True) -> tuple[str, Seen, bool]:
        """
        Return a message for a client, the `Seen` of the client after the message, and whether any section is new.

        The message has the sections that the client has not received yet. seen: state of the client. skipped: number
        of states that the client did not get.

        `now` in the message is the time at which the message was made, for the ages of values. `state_at` is the time
        of the state, which is earlier: without a browser the state is updated once a second.

        cached: whether to use the texts that are kept for all clients; ages in them refer to the first sending.
        """
        snapshot = self.snapshot
        own = {
            **self.own,
            **({} if snapshot is None else snapshot.get("server", {})),
            "clients": len(self.clients),
            "skipped": skipped,
            "ready": snapshot is not None,
        }
        state_at = json.dumps(None if snapshot is None else snapshot["now"])
        head = f'{{"now": {self._now():.3f}, "state_at": {state_at}, "server": {json.dumps(own)}, "sections": {{'
        if snapshot is None:
            return head + "}}", Seen(), False
        parts, now_has, strips = [], snapshot["revisions"], dict(seen.strips)
        for name, section in snapshot["sections"].items():
            if seen.revisions.get(name) == now_has[name]:
                continue
            if name in STRIPS:
                last = strips.get(name)
                if last is not None and (not section["rows"] or section["rows"][-1][0] < last):
                    last = None  # a recording was wound back
                rows = [row for row in section["rows"] if last is None or row[0] > last]
                fresh = {**section, "rows": rows, "whole": last is None}
                parts.append(f"{json.dumps(name)}: {dumps(fresh)}")
                if rows:
                    strips[name] = rows[-1][0]
            else:
                # A client computes ages from `at`, so the same text serves all clients.
                text = self._text(name, now_has[name], section) if cached else dumps(section)
                parts.append(f"{json.dumps(name)}: {text}")
        return head + ", ".join(parts) + "}}", Seen(dict(now_has), strips), bool(parts)

    def _text(self, name: str, revision: int, section: Any) -> str:
        """Return the JSON of a section; it is made once for all clients."""
        known = self._texts.get(name)
        if known is None or known[0] != revision:
            known = self._texts[name] = (revision, dumps(section))
        return known[1]


async def _sent(socket: web.WebSocketResponse, text: str) -> None:
    await socket.send_str(text)
    await socket.ping()


def dumps(table: Any) -> str:
    """Return a table as compact JSON; a number that is not finite raises ValueError."""
    return json.dumps(table, allow_nan=False, separators=(",", ":"))
