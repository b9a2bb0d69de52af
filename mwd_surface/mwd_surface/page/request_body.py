# SPDX-License-Identifier: Apache-2.0
"""Body of a request: read within a time limit and parsed as a JSON object."""

from __future__ import annotations

import asyncio
from typing import Any

from aiohttp import web

from mwd_sensors.core import budgets
from mwd_sensors.core.input_files import load_json


async def read_body(request: web.Request, timeout_s: float) -> bytes:
    """
    Return the body of a request that sends JSON.

    Raises
    ------
    web.HTTPException
        The body has another type, is too large, or did not arrive in time.
    """
    if request.content_type != "application/json":
        # Another site can make a browser send a plain form, but not JSON, without permission.
        raise web.HTTPUnsupportedMediaType(text="send application/json")
    try:
        return await asyncio.wait_for(request.read(), timeout_s)
    except TimeoutError:
        raise web.HTTPRequestTimeout(text="the request did not arrive in time") from None


def json_object(body: bytes) -> dict[str, Any]:
    """
    Return a body parsed as a JSON object; an empty body gives an empty object.

    Raises
    ------
    web.HTTPBadRequest
        The body is not a JSON object, or is nested too deeply.
    """
    try:
        given = load_json(body.decode() or "{}", budgets.PAGE, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise web.HTTPBadRequest(text=f"the body is not JSON: {str(error)[:200]}") from None
    if not isinstance(given, dict):
        raise web.HTTPBadRequest(text="the body must be a JSON object")
    return given


def _refuse_constant(word: str) -> Any:
    raise ValueError(f"{word} is not a number")
