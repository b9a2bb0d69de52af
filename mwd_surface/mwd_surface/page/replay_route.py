# SPDX-License-Identifier: Apache-2.0
"""The request by which the page of a recording is played, paused and wound: POST /replay."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from aiohttp import web

from mwd_surface.page.request_body import json_object, read_body

OnReplay = Callable[[dict[str, float | bool]], None]
_LONGEST_S, _FASTEST = 1e9, 1000.0


def replay_handler(on_replay: OnReplay, timeout_s: float) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
    """
    Handler of the request; its JSON may hold playing (true or false), rate (0.01 to 1000) and seek (s).

    on_replay : called with what was given, in the thread of the server. timeout_s : for the body to arrive.
    """

    async def handle(request: web.Request) -> web.StreamResponse:
        on_replay(_checked(json_object(await read_body(request, timeout_s))))
        return web.json_response({"ok": True, "message": ""})

    return handle


def _checked(given: dict[str, Any]) -> dict[str, float | bool]:
    if not set(given) <= {"playing", "rate", "seek"}:
        raise web.HTTPBadRequest(text="expected a table of playing, rate and seek")
    if not isinstance(given.get("playing", True), bool):
        raise web.HTTPBadRequest(text="playing: expected true or false")
    for name, low, high in (("rate", 0.01, _FASTEST), ("seek", 0.0, _LONGEST_S)):
        value = given.get(name, high)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        # A whole number may be beyond every float; one that is not finite is beyond both ends or compares with none.
        if not number or not low <= value <= high:
            raise web.HTTPBadRequest(text=f"{name}: expected a number from {low:g} to {high:g}")
    return given
