"""The WebSockets of a Socket.IO server's clients: closed in time, and admitted by the handshake."""

import asyncio
import weakref
from collections.abc import Mapping
from functools import partial
from typing import Final

import socketio
from aiohttp import WSCloseCode, web

from mmt.core.running.ending import start_task
from mmt.link.incoming import HandshakeLimit, RateLimit
from mmt.link.queue import UnbufferedSend
from mmt.link.serving.accepting import HANDSHAKE_S, admit_connection
from mmt.link.websocket import LINK_PATH, Handlers, Send, receive_directly

_NAMESPACE: Final = "/"


class ServerSockets:
    """The WebSockets of a Socket.IO server's clients."""

    def __init__(self, server: socketio.AsyncServer, application: web.Application) -> None:
        self._server = server
        # by the id of the request, which lives as long as its response
        self._of_request: weakref.WeakValueDictionary[int, web.WebSocketResponse] = (
            weakref.WeakValueDictionary()
        )
        self._admitted: weakref.WeakSet[web.WebSocketResponse] = weakref.WeakSet()
        self._closing: set[asyncio.Task[bool]] = set()
        application.on_response_prepare.append(self._remember)

    async def _remember(self, request: web.Request, response: web.StreamResponse) -> None:
        if isinstance(response, web.WebSocketResponse) and request.path == LINK_PATH:
            self._of_request[id(request)] = response

            async def cut(**_: object) -> None:
                if request.transport is not None:
                    request.transport.abort()  # data sent in the meantime are not read

            receive_directly(response, {}, HandshakeLimit(), cut)
            loop = asyncio.get_running_loop()
            loop.call_later(HANDSHAKE_S, self._expire, weakref.ref(response))

    def _expire(self, reference: "weakref.ref[web.WebSocketResponse]") -> None:
        """Close a connection that was not admitted in time."""
        websocket = reference()
        if websocket is None or websocket in self._admitted or websocket.closed:
            return
        if not websocket.prepared:
            return  # the client left before it was opened
        start_task(websocket.close(code=WSCloseCode.POLICY_VIOLATION), self._closing)

    async def close(self, timeout_s: float) -> None:
        """Close all open WebSockets, within `timeout_s`."""
        closing = [
            asyncio.ensure_future(websocket.close(code=WSCloseCode.GOING_AWAY))
            for websocket in self._of_request.values()
            if websocket.prepared  # else the client left before it was opened
        ]
        if closing:
            _, waiting = await asyncio.wait(closing, timeout=timeout_s)
            for task in waiting:
                task.cancel()

    def send(self, sid: str, environ: Mapping[str, object]) -> Send:
        """Return the function that sends an encoded message to the client with this environ."""
        websocket = self._websocket(environ)
        if websocket is not None:
            return UnbufferedSend(websocket)
        return partial(
            self._server.eio.send, self._server.manager.eio_sid_from_sid(sid, _NAMESPACE)
        )

    def admit(
        self, environ: Mapping[str, object], handlers: Handlers, rate_limit: RateLimit
    ) -> None:
        """Admit the client with this environ: its events bypass the library, rate-limited."""
        websocket, request = self._websocket(environ), environ.get("aiohttp.request")
        if websocket is not None and isinstance(request, web.Request):
            admit_connection(request)
            self._admitted.add(websocket)
            receive_directly(websocket, handlers, rate_limit)

    def _websocket(self, environ: Mapping[str, object]) -> web.WebSocketResponse | None:
        return self._of_request.get(id(environ.get("aiohttp.request")))
