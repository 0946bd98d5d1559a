"""Hand encoded messages to the WebSocket itself, past the library's own send queue.

python-socketio sends by way of an unbounded queue and two or three tasks, which costs about
0.1 ms and hides a link that is stalled. The messages are whole WebSocket messages, so that
they may go between those of the library. Where a library's version does not show its
WebSocket, they go through the library's queue.
"""

import asyncio
import weakref
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import socketio
from aiohttp import ClientWebSocketResponse, WSCloseCode, web

from mmt.link.backlog import UnbufferedSend
from mmt.link.gate import Gate, StrangersGate
from mmt.link.listening import LINK_PATH
from mmt.link.outbox import Sending
from mmt.link.receiving import Handlers, take_directly

Send = Callable[[bytes], Sending]

_NAMESPACE: Final = "/"

STRANGERS_S: Final = 10.0
"""How long a connection may stay open without a hello that is accepted."""


class ServerSockets:
    """The WebSockets of a Socket.IO server's clients."""

    def __init__(self, server: socketio.AsyncServer, application: web.Application) -> None:
        self._server = server
        # by the request's id, which lives as long as the response that refers to it
        self._of_request: weakref.WeakValueDictionary[int, web.WebSocketResponse] = (
            weakref.WeakValueDictionary()
        )
        self._let_in: weakref.WeakSet[web.WebSocketResponse] = weakref.WeakSet()
        self._closing: set[asyncio.Task[bool]] = set()
        application.on_response_prepare.append(self._remember)

    async def _remember(self, request: web.Request, response: web.StreamResponse) -> None:
        if isinstance(response, web.WebSocketResponse) and request.path == LINK_PATH:
            self._of_request[id(request)] = response
            take_directly(response, {}, StrangersGate())
            loop = asyncio.get_running_loop()
            loop.call_later(STRANGERS_S, self._expire, loop, weakref.ref(response))

    def _expire(
        self, loop: asyncio.AbstractEventLoop, of: "weakref.ref[web.WebSocketResponse]"
    ) -> None:
        """Close the connection of somebody who was not let in for too long."""
        websocket = of()
        if websocket is None or websocket in self._let_in or websocket.closed:
            return
        closing = loop.create_task(websocket.close(code=WSCloseCode.POLICY_VIOLATION))
        self._closing.add(closing)
        closing.add_done_callback(self._closing.discard)

    async def close(self, timeout_s: float) -> None:
        """Close all that are open, for at most this long."""
        closing = [
            asyncio.ensure_future(websocket.close(code=WSCloseCode.GOING_AWAY))
            for websocket in self._of_request.values()
        ]
        if closing:
            _, waiting = await asyncio.wait(closing, timeout=timeout_s)
            for task in waiting:
                task.cancel()

    def send(self, sid: str, environ: Mapping[str, object]) -> Send:
        """Return what sends an encoded message to the client that connects so."""
        websocket = self._websocket(environ)
        if websocket is not None:
            return UnbufferedSend(websocket)
        return partial(
            self._server.eio.send, self._server.manager.eio_sid_from_sid(sid, _NAMESPACE)
        )

    def let_in(self, environ: Mapping[str, object], handlers: Handlers, gate: Gate) -> None:
        """Take these events of the client that connects so past the library, through a gate."""
        websocket = self._websocket(environ)
        if websocket is not None:
            self._let_in.add(websocket)
            take_directly(websocket, handlers, gate)

    def _websocket(self, environ: Mapping[str, object]) -> web.WebSocketResponse | None:
        return self._of_request.get(id(environ.get("aiohttp.request")))


def client_send(client: socketio.AsyncClient) -> Send:
    """Return what sends an encoded message to the server."""
    websocket = getattr(client.eio, "ws", None)
    if isinstance(websocket, ClientWebSocketResponse):
        return UnbufferedSend(websocket)
    send: Send = client.eio.send
    return send
