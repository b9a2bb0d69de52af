# SPDX-License-Identifier: Apache-2.0
"""The request by which the page of a recording is played, paused and wound: POST /replay."""

from __future__ import annotations

import json
import math
from collections.abc import Awaitable, Callable
from typing import Any

from aiohttp import web

OnReplay = Callable[[dict[str, float | bool]], None]
_LONGEST_S, _FASTEST = 1e9, 1000.0


def replay_handler(on_replay: OnReplay) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
    """
    Handler of the request; its JSON may hold playing (true or false), rate (0.01 to 1000) and seek (s).

    on_replay : called with what was given, in the thread of the server.
    """

    async def handle(request: web.Request) -> web.StreamResponse:
        if request.content_type != "application/json":
            # Another site can send a plain form without being asked; not JSON.
            raise web.HTTPUnsupportedMediaType(text="send application/json")
        try:
            given = json.loads(await request.read())
        except ValueError:
            raise web.HTTPBadRequest(text="the body is not JSON") from None
        on_replay(_checked(given))
        return web.json_response({"ok": True, "message": ""})

    return handle


def _checked(given: Any) -> dict[str, float | bool]:
    if not isinstance(given, dict) or not set(given) <= {"playing", "rate", "seek"}:
        raise web.HTTPBadRequest(text="expected a table of playing, rate and seek")
    if not isinstance(given.get("playing", True), bool):
        raise web.HTTPBadRequest(text="playing: expected true or false")
    for name, low, high in (("rate", 0.01, _FASTEST), ("seek", 0.0, _LONGEST_S)):
        value = given.get(name, high)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or not low <= value <= high:
            raise web.HTTPBadRequest(text=f"{name}: expected a number from {low:g} to {high:g}")
    return given
