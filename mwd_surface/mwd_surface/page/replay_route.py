# SPDX-License-Identifier: Apache-2.0
"""Request that plays, pauses and seeks the page of a recording: POST /replay."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from aiohttp import web

from mwd_surface.page.request_body import json_object, read_body

OnReplay = Callable[[dict[str, float | bool]], None]
_LONGEST_S, _FASTEST = 1e9, 1000.0


def replay_handler(on_replay: OnReplay, timeout_s: float) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
    """
    Return the handler of the request; its JSON may hold playing (true or false), rate (0.01 to 1000) and seek (s).

    on_replay: called with the given fields in the thread of the server. timeout_s: longest wait for the body.
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
        # An int may exceed every float. Infinity is beyond a limit, and NaN fails every comparison.
        if not number or not low <= value <= high:
            raise web.HTTPBadRequest(text=f"{name}: expected a number from {low:g} to {high:g}")
    return given
