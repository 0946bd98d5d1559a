"""Serve a recording's page and its requests, over HTTP on loopback.

``GET /session/`` is the page. ``opening``, ``growth``, ``model?number=N``,
``course?from_s=T&to_s=T`` and ``moment?time_s=T`` below it return the monitor's binary
messages. The server keeps no state of a page, so a page may be reloaded or opened twice.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from aiohttp import web

from mmt.core.bounds import finite_number
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

    def add(question: str, make: Callable[..., bytes], *names: str) -> None:
        """Answer a question, with these numbers of its query; in a thread, one at a time."""

        async def answer(request: web.Request) -> web.Response:
            numbers = [_number(request, name) for name in names]
            async with one:
                try:
                    body = await asyncio.to_thread(make, *numbers)
                except InputError as error:
                    raise web.HTTPNotFound(text=f"{error}\n") from error
            return web.Response(body=body, headers={"Cache-Control": "no-store"})

        application.router.add_get(f"{PATH}/{question}", answer)

    add("opening", recording.opening)
    add("growth", recording.growth)
    add("model", lambda number: recording.model(int(number)), "number")
    add("course", recording.course, "from_s", "to_s")
    add("moment", recording.state_at, "time_s")
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
        return finite_number(request.query.get(name, ""))
    except ValueError as error:
        raise web.HTTPBadRequest(text=f"{name} must be a number\n") from error


async def serve_recording(
    recording: ViewedRecording, port: int, ended: asyncio.Event, ready: Callable[[str], None]
) -> None:
    """Serve a recording's page at a port of this machine, and close the recording.

    Parameters
    ----------
    recording
        The recording.
    port
        Port; 0 takes any free one.
    ended
        Ends the serving.
    ready
        Called with the page's URL.

    Raises
    ------
    MmtError
        The port is in use or not allowed.
    """
    listener = Listener(recording_application(recording), _VIEWERS)
    try:
        await listener.start(HOST, port, Access(), allowed=False)
        recording.start()
        ready(f"http://{HOST}:{listener.port}{PATH}/")
        await ended.wait()
    finally:
        await listener.stop()
        await asyncio.to_thread(recording.close)
