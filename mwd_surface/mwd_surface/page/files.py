# SPDX-License-Identifier: Apache-2.0
"""Files of the page, read once and served from memory."""

from __future__ import annotations

import errno
import mimetypes
from collections.abc import Awaitable, Callable
from pathlib import Path

from aiohttp import web

PAGE = Path(__file__).parent / "static"


def page_files(folder: Path) -> dict[str, tuple[bytes, str]]:
    """Return all files of the page by their address; no other files are served."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not any(part.startswith((".", "__")) for part in path.relative_to(folder).parts):
            kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
            if path.suffix == ".js":
                kind = "text/javascript"
            found[path.relative_to(folder).as_posix()] = (path.read_bytes(), kind)
    if "index.html" not in found:
        raise FileNotFoundError(errno.ENOENT, "the page's files are missing; install mwd_surface again", str(folder))
    return found


def sender(body: bytes, kind: str) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
    """Return a handler that sends a file from memory."""

    async def send(_request: web.Request) -> web.StreamResponse:
        charset = "utf-8" if kind.startswith("text/") else None
        return web.Response(body=body, content_type=kind, charset=charset, headers={"Cache-Control": "no-cache"})

    return send
