"""Serve a recording's page and its requests, over HTTP on loopback.

``GET /session/`` is the page. ``opening``, ``growth``, ``model?number=N``,
``course?from_s=T&to_s=T`` and ``moment?time_s=T`` below it return the monitor's binary
messages. The server keeps no state of a page, so a page may be reloaded or opened twice.
"""

import asyncio
import math
from collections.abc import Callable
from typing import Final

from aiohttp import web

from mmt.core.errors import InputError
from mmt.link.access import Access, Entrance
from mmt.link.serving.http import Listener
from mmt.web.page_server import add_page, monitor_files
from mmt.web.viewing.recording import ViewedRecording

HOST: Final = "127.0.0.1"
PATH: Final = "/session"
_VIEWERS: Final = Entrance("the recording's page", "--port", "leave the host as it is")


def recording_application(recording: ViewedRecording) -> web.Application:
    """Return the web application that shows a recording."""
    application, one = web.Application(), asyncio.Lock()

    async def answer(make: Callable[[], bytes]) -> web.Response:
        """Make a message in a thread, one at a time."""
        async with one:
            try:
                body = await asyncio.to_thread(make)
            except InputError as error:
                raise web.HTTPNotFound(text=f"{error}\n") from error
        return web.Response(body=body, headers={"Cache-Control": "no-store"})

    async def opening(_: web.Request) -> web.Response:
        return await answer(recording.opening)

    async def growth(_: web.Request) -> web.Response:
        return await answer(recording.growth)

    async def model(request: web.Request) -> web.Response:
        number = int(_number(request, "number"))
        return await answer(lambda: recording.model(number))

    async def course(request: web.Request) -> web.Response:
        from_s, to_s = _number(request, "from_s"), _number(request, "to_s")
        return await answer(lambda: recording.course(from_s, to_s))

    async def moment(request: web.Request) -> web.Response:
        time_s = _number(request, "time_s")
        return await answer(lambda: recording.state_at(time_s))

    for handler in (opening, growth, model, course, moment):
        application.router.add_get(f"{PATH}/{handler.__name__}", handler)
    add_page(application, PATH, monitor_files("recording.js"))
    return application


def _number(request: web.Request, name: str) -> float:
    """Return a finite number from a request's query.

    Raises
    ------
    web.HTTPBadRequest
        The value is missing or not a finite number.
    """
    try:
        value = float(request.query.get(name, ""))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise web.HTTPBadRequest(text=f"{name} must be a number\n")
    return value


class RecordingServer:
    """Serves a recording's page at a port of this machine.

    Parameters
    ----------
    recording
        The recording; closed when `run` ends.
    port
        Port; 0 takes any free one.
    """

    def __init__(self, recording: ViewedRecording, port: int = 0) -> None:
        self._recording, self._port = recording, port
        self._listener = Listener(recording_application(recording), _VIEWERS)
        self._ended = asyncio.Event()

    def stop(self) -> None:
        """Make `run` return."""
        self._ended.set()

    async def run(self, ready: Callable[[str], None]) -> None:
        """Serve until `stop`; `ready` is called with the page's URL.

        Raises
        ------
        MmtError
            The port is in use or not allowed.
        """
        try:
            await self._listener.start(HOST, self._port, Access(), allowed=False)
            self._recording.start()
            ready(f"http://{HOST}:{self._listener.port}{PATH}/")
            await self._ended.wait()
        finally:
            await self._listener.stop()
            await asyncio.to_thread(self._recording.close)
