"""Serve pages to a browser, and open their WebSockets for authorized pages only.

The pages are static files that a browser runs as they are; the libraries under ``pages/vendor``
are copies of published releases, each beside its licence, so that the pages work without a
network. The files hold nothing secret and are served to everyone who reaches the port.

A WebSocket is protected as the link is: where there is a token, the page sends it in the first
message, since a browser cannot set a header there. Pages of other sites in the same browser are
refused before any of this, by `mmt.link.http.own_pages_only`.
"""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from aiohttp import WSMessage, WSMsgType, web

from mmt.core.palette import style_sheet
from mmt.link.accepting import HANDSHAKE_S, admit_connection
from mmt.link.access import Access

_FOLDER: Final = Path(__file__).parent / "pages"

_TYPES: Final = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
}

_VENDORED: Final = {
    "uPlot.js": "vendor/uplot/uPlot.esm.js",
    "uPlot.css": "vendor/uplot/uPlot.min.css",
}


@dataclass(frozen=True)
class PageFile:
    """A file with its content type."""

    body: bytes
    content_type: str


MAIN: Final = "main.js"
"""The module with which the monitor's page starts: one for a run, another for a recording."""


def monitor_files(main: str = "monitor.js") -> dict[str, PageFile]:
    """Return the monitor's files by their names in its page; some 200 KB.

    Parameters
    ----------
    main
        The module to start with: ``monitor.js`` for a run, ``recording.js`` for a recording.
    """
    files = page_files(_FOLDER / "monitor", _VENDORED)
    return {**files, MAIN: files[main]}


def page_files(folder: Path, vendored: Mapping[str, str]) -> dict[str, PageFile]:
    """Return a page's own files, those that pages share, and libraries by the names given.

    Parameters
    ----------
    folder
        Holds the page's own files.
    vendored
        Libraries below ``pages``, by their names in the page.
    """
    paths = {
        path.name: path
        for files in (_FOLDER / "shared", folder)
        for path in sorted(files.iterdir())
        if path.suffix in _TYPES
    }
    paths |= {name: _FOLDER / path for name, path in vendored.items()}
    files = {name: PageFile(path.read_bytes(), _TYPES[path.suffix]) for name, path in paths.items()}
    return {**files, "palette.css": PageFile(style_sheet().encode(), _TYPES[".css"])}


REFUSED: Final = 4401
"""Close code: the token is missing or wrong."""
GOING_AWAY: Final = 1001

_MOST_BYTES: Final = 4096
_HEARTBEAT_S: Final = 10.0

_HEADERS: Final = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}


def add_page(application: web.Application, path: str, files: Mapping[str, PageFile]) -> None:
    """Serve a page's files below a path such as ``/monitor``."""

    async def redirect(_: web.Request) -> web.StreamResponse:
        raise web.HTTPFound(f"{path}/")

    async def file(request: web.Request) -> web.StreamResponse:
        found = files.get(request.match_info["name"] or "index.html")
        if found is None:
            raise web.HTTPNotFound
        return web.Response(body=found.body, content_type=found.content_type, headers=_HEADERS)

    application.router.add_get(path, redirect)
    application.router.add_get(f"{path}/{{name:[^/]*}}", file)


class _PageSocket(web.WebSocketResponse):
    """A WebSocket without ``autoping``: a stranger's pings are not answered."""

    answers_pings = False

    async def receive(self, timeout: float | None = None) -> WSMessage:
        """Return the next message; once admitted, pings are answered and pongs left out."""
        while True:
            message = await super().receive(timeout)
            if not self.answers_pings or message.type not in {WSMsgType.PING, WSMsgType.PONG}:
                return message
            if message.type is WSMsgType.PING:
                await self.pong(message.data)


async def open_socket(
    request: web.Request, access: Access, most_bytes: int = _MOST_BYTES
) -> tuple[web.WebSocketResponse, bool]:
    """Open a WebSocket and read its first message; return it, and whether it has the token.

    Without the token it is closed. `most_bytes` is the largest message that it accepts.
    """
    socket = _PageSocket(
        timeout=1.0, heartbeat=_HEARTBEAT_S, compress=False, max_msg_size=most_bytes, autoping=False
    )
    await socket.prepare(request)
    admitted = access.admits(await _token(socket))
    if admitted:
        socket.answers_pings = True
        admit_connection(request)
    else:
        await socket.close(code=REFUSED, message=b"the token is missing or wrong")
    return socket, admitted


async def _token(socket: web.WebSocketResponse) -> Any:
    """Return the token of the first message, None where it has none."""
    with suppress(TimeoutError, ValueError, TypeError, AttributeError):
        return json.loads(await socket.receive_str(timeout=HANDSHAKE_S)).get("token")
    return None
