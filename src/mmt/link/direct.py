"""Hand encoded messages to the WebSocket itself, past the library's own send queue.

python-socketio sends by way of an unbounded queue and two or three tasks, which costs about
0.1 ms and hides a link that is stalled. The messages are whole WebSocket messages, so that
they may go between those of the library. Where a library's version does not show its
WebSocket, they go through the library's queue.
"""

import asyncio
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final
from weakref import WeakValueDictionary

import socketio
from aiohttp import ClientWebSocketResponse, WSCloseCode, web

from mmt.link.outbox import Sending
from mmt.link.receiving import Handlers, take_directly

Send = Callable[[bytes], Sending]

_NAMESPACE: Final = "/"


class ServerSockets:
    """The WebSockets of a Socket.IO server's clients."""

    def __init__(self, server: socketio.AsyncServer, application: web.Application) -> None:
        self._server = server
        # by the request's id, which lives as long as the response that refers to it
        self._of_request: WeakValueDictionary[int, web.WebSocketResponse] = WeakValueDictionary()
        application.on_response_prepare.append(self._remember)

    async def _remember(self, request: web.Request, response: web.StreamResponse) -> None:
        if isinstance(response, web.WebSocketResponse):
            self._of_request[id(request)] = response

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
            return websocket.send_bytes
        return partial(
            self._server.eio.send, self._server.manager.eio_sid_from_sid(sid, _NAMESPACE)
        )

    def receive(self, environ: Mapping[str, object], handlers: Handlers) -> None:
        """Take these events of the client that connects so past the library."""
        websocket = self._websocket(environ)
        if websocket is not None:
            take_directly(websocket, handlers)

    def _websocket(self, environ: Mapping[str, object]) -> web.WebSocketResponse | None:
        return self._of_request.get(id(environ.get("aiohttp.request")))


def client_send(client: socketio.AsyncClient) -> Send:
    """Return what sends an encoded message to the server."""
    websocket = getattr(client.eio, "ws", None)
    if isinstance(websocket, ClientWebSocketResponse):
        return websocket.send_bytes
    send: Send = client.eio.send
    return send
