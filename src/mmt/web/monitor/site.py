"""The monitor's page and its socket."""

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING

from aiohttp import WSMsgType, web

from mmt.link.access import Access
from mmt.scene import Scene
from mmt.web.monitor.controls import Controls
from mmt.web.monitor.viewers import Viewer, Viewers
from mmt.web.page_server import (
    GOING_AWAY,
    add_page,
    monitor_files,
    open_socket,
    refuse_foreign_page,
)

if TYPE_CHECKING:
    from mmt.link.http import Page


def monitor_page(viewers: Viewers, controls: Controls, scene: Scene) -> "Page":
    """Return the page ``/monitor/`` and its socket ``/monitor/socket``."""
    files = monitor_files()
    host = scene.link.host if scene.link is not None else ""

    def add(application: web.Application, access: Access) -> None:
        async def look_on(request: web.Request) -> web.StreamResponse:
            refuse_foreign_page(request, access, host)
            if viewers.full:
                raise web.HTTPServiceUnavailable(text="too many viewers\n")
            return await _serve(request, access, viewers, controls)

        application.router.add_get("/monitor/socket", look_on)
        add_page(application, "/monitor", files)

    return add


async def _serve(
    request: web.Request, access: Access, viewers: Viewers, controls: Controls
) -> web.WebSocketResponse:
    """Let one browser look on until it leaves or the session ends."""
    socket, admitted = await open_socket(request, access)
    if not admitted:
        return socket
    if viewers.full:
        await socket.close(code=GOING_AWAY, message=b"too many viewers")
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


async def _send(socket: web.WebSocketResponse, viewer: Viewer) -> None:
    with suppress(ConnectionError):
        await viewer.send(socket)
        await socket.close(code=GOING_AWAY, message=b"the session has ended")
