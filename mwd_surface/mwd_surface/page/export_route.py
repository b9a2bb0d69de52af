# SPDX-License-Identifier: Apache-2.0
"""Route of the page to the exported files, so that a tablet without access to the surface unit's disk gets them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from aiohttp import web

from mwd_sensors.core.foreign_text import not_a_file_name
from mwd_surface.page.state_feed import dumps

_MOST = 200  # files listed, the newest

Allowed = Callable[[web.Request], Awaitable[Any]]


def add_export_routes(router: web.UrlDispatcher, folder: Path, allowed: Allowed) -> None:
    """
    Add `/exports`, the list of exported files, newest first, and `/exports/NAME`, one of them as a download.

    allowed: function that is called with each request first; it raises `web.HTTPException` if the token is missing.
    """

    async def listed(request: web.Request) -> web.StreamResponse:
        await allowed(request)
        return web.json_response({"files": await asyncio.to_thread(exported_files, folder)}, dumps=dumps)

    async def sent(request: web.Request) -> web.StreamResponse:
        await allowed(request)
        name = request.match_info["name"]
        path = folder / name
        if not_a_file_name(name) or name.startswith(".") or path.is_symlink() or not path.is_file():
            raise web.HTTPNotFound(text=f"{name[:60]!r} is not one of the exported files")
        headers = {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
        return web.FileResponse(path, headers=headers)

    router.add_get("/exports", listed)
    router.add_get("/exports/{name}", sent)


def exported_files(folder: Path) -> list[dict[str, Any]]:
    """Return name, size in bytes and time of change, s since the epoch, of the exported files, newest first."""
    if not folder.is_dir():
        return []
    found: list[dict[str, Any]] = [
        {"name": path.name, "bytes": (of := path.stat()).st_size, "changed": of.st_mtime}
        for path in folder.iterdir()
        if path.is_file() and not path.is_symlink() and not path.name.startswith(".")
    ]
    return sorted(found, key=lambda one: one["changed"], reverse=True)[:_MOST]
