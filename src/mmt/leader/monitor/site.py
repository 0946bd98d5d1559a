"""The monitor's page and its socket, for who may see them.

The files hold nothing secret and are served to everyone who reaches the port. The socket is
as closed as the link: with a token it opens for who shows it in the first message, since a
browser cannot set a header there. A page of another site that runs in the person's own
browser reaches the port too; so the socket asks for an origin of its own, and without a
token for an address in the place of a name, which another site could have pointed here.
"""

import asyncio
import ipaddress
import json
import socket as system
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from aiohttp import WSMsgType, web

from mmt import pages
from mmt.leader.monitor.controls import Controls
from mmt.leader.monitor.viewers import Viewer, Viewers
from mmt.link.access import Access
from mmt.scene import Scene

if TYPE_CHECKING:
    from mmt.link.pages import Page

_TOKEN_WAIT_S: Final = 10.0
_MOST_BYTES: Final = 4096
_HEARTBEAT_S: Final = 10.0
_REFUSED: Final = 4401
"""Close code: the token is missing or wrong."""
_GOING_AWAY: Final = 1001

_HEADERS: Final = {
    "Cache-Control": "no-cache",
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}


def monitor_page(viewers: Viewers, controls: Controls, scene: Scene) -> "Page":
    """Return the page ``/monitor/`` and its socket ``/monitor/socket``."""
    files = pages.monitor_files()
    host = scene.link.host if scene.link is not None else ""

    async def redirect(_: web.Request) -> web.StreamResponse:
        raise web.HTTPFound("/monitor/")

    async def file(request: web.Request) -> web.StreamResponse:
        found = files.get(request.match_info["name"] or "index.html")
        if found is None:
            raise web.HTTPNotFound
        return web.Response(body=found.body, content_type=found.content_type, headers=_HEADERS)

    def add(application: web.Application, access: Access) -> None:
        async def look_on(request: web.Request) -> web.StreamResponse:
            problem = _stranger(request, access, host)
            if problem is not None:
                raise web.HTTPForbidden(text=problem)
            if viewers.full:
                raise web.HTTPServiceUnavailable(text="too many viewers\n")
            return await _serve(request, access, viewers, controls)

        application.router.add_get("/monitor", redirect)
        application.router.add_get("/monitor/socket", look_on)
        application.router.add_get("/monitor/{name:[^/]*}", file)

    return add


def _stranger(request: web.Request, access: Access, host: str) -> str | None:
    """Say why a request is none of the monitor's own page, None where it is one."""
    origin = request.headers.get("Origin")
    if origin is not None and urlsplit(origin).netloc.lower() != request.host.lower():
        return "another site's page cannot look on\n"
    name = (urlsplit(f"//{request.host}").hostname or "").lower()
    own = {"localhost", host.lower(), system.gethostname().lower()}
    if access.token is None and name not in own and not _is_address(name):
        return "open the page by the leader's address, or give the leader a token\n"
    return None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


async def _serve(
    request: web.Request, access: Access, viewers: Viewers, controls: Controls
) -> web.WebSocketResponse:
    """Let one browser look on until it leaves or the session ends."""
    socket = web.WebSocketResponse(
        timeout=1.0, heartbeat=_HEARTBEAT_S, compress=False, max_msg_size=_MOST_BYTES
    )
    await socket.prepare(request)
    if not access.admits(await _token(socket)):
        await socket.close(code=_REFUSED, message=b"the token is missing or wrong")
        return socket
    if viewers.full:
        await socket.close(code=_GOING_AWAY, message=b"too many viewers")
        return socket
    viewer = viewers.add()
    sending = asyncio.create_task(_send(socket, viewer))
    try:
        async for message in socket:
            if message.type is not WSMsgType.TEXT:
                break
            viewer.offer(*await controls.answer(message.data))
    finally:
        viewers.remove(viewer)
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)
    return socket


async def _token(socket: web.WebSocketResponse) -> Any:
    """Return the token of the first message, None where it has none."""
    with suppress(TimeoutError, ValueError, TypeError, AttributeError):
        return json.loads(await socket.receive_str(timeout=_TOKEN_WAIT_S)).get("token")
    return None


async def _send(socket: web.WebSocketResponse, viewer: Viewer) -> None:
    with suppress(ConnectionError):
        await viewer.send(socket)
        await socket.close(code=_GOING_AWAY, message=b"the session has ended")
