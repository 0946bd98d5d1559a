"""Serve pages to a browser, and open WebSockets for authorized pages only.

The pages are static files without a build step. ``pages/vendor`` has copies of published
libraries, each with its licence, so that the pages work without internet access. The files hold
no secrets and are served without authorization.

A WebSocket is protected like the link: if there is a token, the page sends it in the first
message, since a browser cannot set a header for WebSockets. `mmt.link.serving.http.own_pages_only`
has already refused requests from pages of other sites.

A message consists of the header's length (uint32), the header padded with spaces to a multiple
of four bytes, and the arrays in sequence; all numbers are little-endian, the arrays float32.
``arrays`` in the header lists name and shape of each. Encoding arrays as JSON text would take
about ten times as long.
"""

import json
import struct
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from aiohttp import WSMessage, WSMsgType, web

from mmt.core.output.palette import style_sheet
from mmt.link.access import Access
from mmt.link.serving.accepting import HANDSHAKE_S, admit_connection
from mmt.session.data import json_value

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


def monitor_files(main: str = "monitor.js") -> dict[str, bytes]:
    """Return the files of the monitor's page by name, about 200 KB.

    Parameters
    ----------
    main
        The main module, which the page loads as ``main.js``: ``monitor.js`` for a run,
        ``recording.js`` for a recording.
    """
    files = page_files(_FOLDER / "monitor", _VENDORED)
    return {**files, "main.js": files[main]}


def page_files(folder: Path, vendored: Mapping[str, str]) -> dict[str, bytes]:
    """Return a page's own files, the shared files and libraries, by their names in the page.

    Parameters
    ----------
    folder
        Folder with the page's own files.
    vendored
        Paths of libraries below ``pages``, by name.
    """
    paths = {
        path.name: path
        for files in (_FOLDER / "shared", folder)
        for path in sorted(files.iterdir())
        if path.suffix in _TYPES
    }
    paths |= {name: _FOLDER / path for name, path in vendored.items()}
    files = {name: path.read_bytes() for name, path in paths.items()}
    return {**files, "palette.css": style_sheet().encode()}


REFUSED: Final = 4401
"""Close code: the token is missing or wrong."""

_MOST_BYTES: Final = 4096
_HEARTBEAT_S: Final = 10.0

_HEADERS: Final = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}


def add_page(application: web.Application, path: str, files: Mapping[str, bytes]) -> None:
    """Serve a page's files below a path such as ``/monitor``."""

    async def redirect(_: web.Request) -> web.StreamResponse:
        raise web.HTTPFound(f"{path}/")

    async def file(request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"] or "index.html"
        if name not in files:
            raise web.HTTPNotFound
        content_type = _TYPES.get(Path(name).suffix)
        return web.Response(body=files[name], content_type=content_type, headers=_HEADERS)

    application.router.add_get(path, redirect)
    application.router.add_get(f"{path}/{{name:[^/]*}}", file)


class _PageSocket(web.WebSocketResponse):
    """A WebSocket that answers pings only after the client is authorized."""

    answers_pings = False

    async def receive(self, timeout: float | None = None) -> WSMessage:
        """Return the next message; once `answers_pings` is set, handle pings and pongs here."""
        while True:
            message = await super().receive(timeout)
            if not self.answers_pings or message.type not in {WSMsgType.PING, WSMsgType.PONG}:
                return message
            if message.type is WSMsgType.PING:
                await self.pong(message.data)


async def open_socket(
    request: web.Request, access: Access, most_bytes: int = _MOST_BYTES
) -> tuple[web.WebSocketResponse, bool]:
    """Open a WebSocket and check the token in its first message; return socket and result.

    A socket without the token is closed. `most_bytes` is the largest accepted message.
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
    """Return the token in the first message, or None if there is none."""
    with suppress(TimeoutError, ValueError, TypeError, AttributeError, RecursionError):
        return json.loads(await socket.receive_str(timeout=HANDSHAKE_S)).get("token")
    return None


def pack(kind: str, header: Mapping[str, Any], arrays: Mapping[str, npt.ArrayLike]) -> bytes:
    """Encode one message.

    Parameters
    ----------
    kind
        Kind of message, for the page.
    header
        JSON values; numbers that are not finite become null.
    arrays
        Arrays of any shape, by name; values become float32.
    """
    packed = {name: np.ascontiguousarray(values, dtype="<f4") for name, values in arrays.items()}
    table = {
        "kind": kind,
        **header,
        "arrays": [[name, list(values.shape)] for name, values in packed.items()],
    }
    try:
        text = json.dumps(table, separators=(",", ":"), allow_nan=False)
    except ValueError:
        text = json.dumps(json_value(table), separators=(",", ":"), allow_nan=False)
    encoded = text.encode()
    encoded += b" " * (-len(encoded) % 4)
    return b"".join(
        [struct.pack("<I", len(encoded)), encoded, *(v.tobytes() for v in packed.values())]
    )


def header_of(message: bytes) -> Any:
    """Return the header of a message, with names and shapes in ``arrays``.

    Raises
    ------
    ValueError
        The bytes are not such a message.
    """
    return json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")])
