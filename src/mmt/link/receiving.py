"""Take the frequent events from the WebSocket itself, before the library sees them.

python-engineio and python-socketio spend one to three tasks, a timer and several turns of the
event loop on every message. Both ask their WebSocket for the next message by its public
``receive``; here that method hands the events it was told of to their handlers and returns
only what is left, so that connecting, pings, acknowledgements and all other events stay the
library's. Pings come every second, well within the time that the library waits for a message.
Where a version asks its WebSocket in another way, every event goes through the library, which
has the same handlers.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from typing import Final

import msgpack
from aiohttp import ClientWebSocketResponse, WSCloseCode, WSMessage, WSMsgType, web

from mmt.link.gate import Gate, StrangersGate
from mmt.link.log import LOG
from mmt.link.protocol import EVENT_NAMESPACE, MAX_MESSAGE_BYTES, MSGPACK_EVENT

Handlers = Mapping[str, Callable[[bytes], None]]
"""By event; called on the loop with the event's one argument, must return soon and not raise."""

Receive = Callable[[], Awaitable[WSMessage]]
Close = Callable[..., Awaitable[object]]
AnyGate = Gate | StrangersGate

_BURST: Final = 64
"""Messages that may be taken or thrown away before the rest of the loop has its turn."""
_CLOSED: Final = WSMessage(WSMsgType.CLOSED, None, None)


def binary_event(message: bytes) -> tuple[str, bytes] | None:
    """Return name and argument of an event that may be taken past the library.

    Parameters
    ----------
    message
        Any binary WebSocket message, as anybody may have sent it.

    Returns
    -------
    name, argument
        None unless it is an event of our namespace with one binary argument that asks for no
        acknowledgement.
    """
    try:
        packet = msgpack.unpackb(message)
    except (ValueError, TypeError, OverflowError, RecursionError):
        return None
    if (
        not isinstance(packet, dict)
        or packet.get("type") != MSGPACK_EVENT
        or packet.get("nsp") != EVENT_NAMESPACE
        or packet.get("id") is not None
    ):
        return None
    data = packet.get("data")
    if not isinstance(data, list) or len(data) != 2:  # a match statement takes three times as long
        return None
    name, argument = data
    return (name, argument) if isinstance(name, str) and isinstance(argument, bytes) else None


def client_websocket(handlers: Handlers, gate: Gate) -> type[ClientWebSocketResponse]:
    """Return the class of a client's WebSocket that takes these events itself, through a gate."""

    class DirectWebSocket(ClientWebSocketResponse):
        async def receive(self, timeout: float | None = None) -> WSMessage:
            return await _rest(partial(super().receive, timeout), self.close, gate, handlers)

    return DirectWebSocket


def take_directly(websocket: web.WebSocketResponse, handlers: Handlers, gate: AnyGate) -> None:
    """Let a server's WebSocket take these events itself, through a gate, from now on."""
    receive = partial(type(websocket).receive, websocket)
    rest = partial(_rest, receive, websocket.close, gate, handlers)
    try:
        websocket.receive = rest  # type: ignore[method-assign]
    except AttributeError:
        LOG.info("this version of aiohttp keeps its WebSocket closed: the library's way is taken")


async def _rest(receive: Receive, close: Close, gate: AnyGate, handlers: Handlers) -> WSMessage:
    """Return the next message that passes the gate and is not for one of the handlers.

    All in one coroutine: each further one costs the usual message a few microseconds.
    """
    turn = 0
    while True:
        message = await receive()
        kind = message.type
        if kind is not WSMsgType.BINARY and kind is not WSMsgType.TEXT:
            return message
        if gate.passes(len(message.data), time.monotonic_ns()):
            # what is too long older libraries find out for themselves
            if kind is WSMsgType.TEXT or len(message.data) > MAX_MESSAGE_BYTES:
                return message
            event = binary_event(message.data)
            handler = handlers.get(event[0]) if event is not None else None
            if event is None or handler is None:
                return message
            handler(event[1])
        elif gate.shut:
            await close(code=WSCloseCode.POLICY_VIOLATION, message=b"too many messages")
            return _CLOSED
        turn += 1
        if turn % _BURST == 0:
            await asyncio.sleep(0)
