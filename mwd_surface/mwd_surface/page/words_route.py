# SPDX-License-Identifier: Apache-2.0
"""Route to the page's texts in a language: the message catalogue as JSON."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from aiohttp import web

from mwd_surface.language.language import language
from mwd_surface.page.state_feed import dumps


def words_handler(default: str) -> Callable[[web.Request], Awaitable[web.Response]]:
    """
    Return the handler of ``words.json?lang=CODE``.

    default: language for a request without a code, or with a code that has no catalogue.

    Raises
    ------
    ValueError
        There is no catalogue for the default language.
    """
    language(default)

    def text(code: str) -> str:
        try:
            return dumps(language(code).table())
        except ValueError:
            return dumps(language(default).table())

    async def send(request: web.Request) -> web.Response:
        body = await asyncio.to_thread(text, request.query.get("lang") or default)
        return web.Response(text=body, content_type="application/json", headers={"Cache-Control": "no-cache"})

    return send
