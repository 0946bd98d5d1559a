"""Send and receive messages on the WebSocket itself, rate-limited, past Socket.IO's own queues.

Sending: python-socketio sends through an unbounded queue and two or three tasks, which costs about
0.1 ms and hides a stalled link. The messages here are whole WebSocket messages, so that they may
be mixed with those of the library. If a version of the library hides its WebSocket, they go
through the library's queue.

Receiving: python-engineio and python-socketio spend one to three tasks, a timer and several turns
of the event loop on every message. Both call the public ``receive`` of their WebSocket. This
module replaces that method: it passes frequent events to their handlers and returns all other
messages, so that connecting, pings, acknowledgements and other events stay with the library. Pings
come often enough for the library's timeout. Packets are decoded once, those of strangers within
narrow bounds. If a version of the library reads in another way, every event goes through the
library, which has the same handlers.
"""

import asyncio
import json
import logging
import time
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from typing import Any, Final

import msgpack
import socketio
from aiohttp import ClientWebSocketResponse, WSCloseCode, WSMessage, WSMsgType, web
from aiohttp.http_exceptions import HttpProcessingError
from socketio.msgpack_packet import MsgPackPacket

from mmt.core.output.logs import RepeatLimit
from mmt.link.incoming import HandshakeLimit, RateLimit
from mmt.link.protocol import EVENT_NAMESPACE, MAX_MESSAGE_BYTES, MSGPACK_EVENT
from mmt.link.queue import Sending, UnbufferedSend

LOG: Final = logging.getLogger("mmt.link")

LINK_PATH: Final = "/socket.io/"
"""Path of Socket.IO connections; a follower shows its token in its hello."""

Handlers = Mapping[str, Callable[[bytes], None]]
"""Handlers by event, called on the loop with its one argument; must return soon and not raise."""

Receive = Callable[[], Awaitable[WSMessage]]
Close = Callable[..., Awaitable[object]]
AnyRateLimit = RateLimit | HandshakeLimit

_PACKETS: Final = tuple("012356")
"""First characters of Engine.IO's texts; after any other the library silently stops reading."""
_SOCKET_IO: Final = "4"
"""First character of a text with a Socket.IO message, which msgpack would make binary."""
_USE_MSGPACK: Final = "44" + json.dumps(
    {
        "message": "this server speaks msgpack: give your client a msgpack parser (in JavaScript "
        "{parser: require('socket.io-msgpack-parser')}, in Python serializer='msgpack')"
    }
)
"""A connect error as text, for a client without msgpack."""
_BURST: Final = 64
"""Messages handled in a row before the event loop runs its other tasks."""
_LIMITED: Final = {WSMsgType.BINARY, WSMsgType.TEXT, WSMsgType.PING, WSMsgType.PONG}
"""Types of messages that the rate limit counts."""
_CLOSED: Final = WSMessage(WSMsgType.CLOSED, None, None)
_RESERVED: Final = {"connect", "connect_error", "disconnect"}
_MOST_OF_STRANGER: Final = 32
"""Maps and arrays that a message may have before admission, and items that each may have."""


def client_websocket(handlers: Handlers, rate_limit: RateLimit) -> type[ClientWebSocketResponse]:
    """Return a client WebSocket class that handles these events itself, rate-limited."""

    class DirectWebSocket(ClientWebSocketResponse):
        async def receive(self, timeout: float | None = None) -> WSMessage:
            return await receive_rest(
                partial(super().receive, timeout), self.pong, self.close, rate_limit, handlers
            )

    return DirectWebSocket


def receive_directly(
    websocket: web.WebSocketResponse,
    handlers: Handlers,
    rate_limit: AnyRateLimit,
    close: Close | None = None,
) -> None:
    """Make a server's WebSocket handle these events itself, rate-limited, from now on.

    Pings count too. `close` ends the connection of a client that exceeds the limit; None for a
    closing handshake, which the client may answer.
    """
    receive = partial(type(websocket).receive, websocket)

    async def refuse() -> None:
        await websocket.send_str(_USE_MSGPACK)
        await websocket.close(code=WSCloseCode.UNSUPPORTED_DATA, message=b"msgpack alone")

    rest = partial(
        receive_rest,
        receive,
        websocket.pong,
        close or websocket.close,
        rate_limit,
        handlers,
        refuse if isinstance(rate_limit, HandshakeLimit) else None,  # admitted clients stay
    )
    try:
        websocket.receive = rest  # type: ignore[method-assign]
        # engineio makes the socket, and aiohttp takes this option only at construction
        websocket._autoping = False
    except AttributeError:
        LOG.info(
            "this version of aiohttp cannot replace its receive: all events go through the library"
        )


async def receive_rest(
    receive: Receive,
    pong: Callable[[bytes], Awaitable[None]],
    close: Close,
    rate_limit: AnyRateLimit,
    handlers: Handlers,
    refuse: Callable[[], Awaitable[None]] | None = None,
) -> WSMessage:
    """Return the next message within the rate limit that none of the handlers handles.

    One coroutine does all of this: each further one costs a few microseconds a message.
    """
    turn = 0
    while True:
        message = await receive()
        kind = message.type
        if kind not in _LIMITED:
            return message
        if rate_limit.passes(len(message.data), time.monotonic_ns()):
            # the library itself rejects messages that are too long
            if len(message.data) > MAX_MESSAGE_BYTES:
                return message
            if kind is WSMsgType.TEXT:
                rest = await _texts(message.data, rate_limit, refuse)
                if rest is not None:
                    return message if rest else _CLOSED
            elif kind is WSMsgType.BINARY:
                packet = _dispatch(message.data, rate_limit, handlers)
                if packet is not None:
                    return message._replace(data=packet)
            elif kind is WSMsgType.PING:
                await pong(message.data)
        elif rate_limit.shut:
            await close(code=WSCloseCode.POLICY_VIOLATION, message=b"too many messages")
            return _CLOSED
        turn += 1
        if turn % _BURST == 0:
            await asyncio.sleep(0)


async def _texts(
    text: str, rate_limit: AnyRateLimit, refuse: Callable[[], Awaitable[None]] | None
) -> bool | None:
    """Return True for a text of the library, False if it ended the connection, None if dropped."""
    if text.startswith(_PACKETS):
        return True
    without = text.startswith(_SOCKET_IO)
    rate_limit.drop("packet without msgpack" if without else "malformed packet")
    if not without or refuse is None:
        return None
    await refuse()
    return False


class Packet(MsgPackPacket):  # type: ignore[misc]  # the library has no types
    """The library's Socket.IO packet, which does not decode a `DecodedPacket` again."""

    def decode(self, encoded_packet: bytes) -> None:
        """Set this packet's fields from a message; see the library."""
        packet = (
            encoded_packet.packet
            if isinstance(encoded_packet, DecodedPacket)
            else decode_packet(encoded_packet)
        )
        if packet is None:
            raise ValueError("malformed packet")
        self.packet_type, self.namespace = packet["type"], packet["nsp"]
        self.data, self.id = packet.get("data"), packet.get("id")


class DecodedPacket(bytes):
    """A message with its decoded packet."""

    packet: dict[str, Any]


def decode_packet(message: bytes, *, stranger: bool = False) -> dict[str, Any] | None:
    """Decode a Socket.IO packet, which is not trusted; None if it is malformed.

    A stranger's packet may have no more maps, arrays and items than a hello needs. This is checked
    during decoding, because 100 kB of empty maps would take milliseconds.
    """
    limits: dict[str, Any] = {"ext_hook": _octets}
    if stranger:
        left = iter(range(_MOST_OF_STRANGER))

        def count(container: Any) -> Any:
            if next(left, None) is None:
                raise ValueError("too many maps and arrays")
            return container

        limits |= dict.fromkeys(("max_map_len", "max_array_len"), _MOST_OF_STRANGER)
        limits |= {"object_hook": count, "list_hook": count}
    try:
        packet = msgpack.unpackb(message, **limits)
    except (ValueError, TypeError, OverflowError, RecursionError):
        return None
    return packet if isinstance(packet, dict) and {"type", "nsp"} <= packet.keys() else None


def _octets(code: int, data: bytes) -> object:
    """Return bytes for extension 0, as which JavaScript's parser sends an ``ArrayBuffer``."""
    return data if code == 0 else msgpack.ExtType(code, data)


def binary_event(packet: Mapping[str, Any]) -> tuple[str, bytes] | None:
    """Return name and argument of an event that may bypass the library, else None.

    Such an event has the link's namespace and one binary argument, and asks for no acknowledgement.
    """
    if packet["nsp"] != EVENT_NAMESPACE or packet.get("id") is not None:
        return None
    match packet:
        case {"type": int(kind), "data": [str(name), bytes(argument)]}:
            return (name, argument) if kind == MSGPACK_EVENT else None
    return None


def is_reserved(packet: Mapping[str, Any]) -> bool:
    """Return whether this is an event with the name of one of the library's own handlers."""
    match packet:
        case {"type": int(kind), "data": [str(name), *_]}:
            return kind == MSGPACK_EVENT and name in _RESERVED
    return False


def _dispatch(message: bytes, rate_limit: AnyRateLimit, handlers: Handlers) -> DecodedPacket | None:
    """Pass an event to its handler, or return the decoded packet for the library."""
    packet = decode_packet(message, stranger=isinstance(rate_limit, HandshakeLimit))
    if packet is None:
        rate_limit.drop("malformed packet")
        return None
    event = binary_event(packet)
    handler = handlers.get(event[0]) if event is not None else None
    if event is not None and handler is not None:
        handler(event[1])
    elif is_reserved(packet):
        rate_limit.drop("reserved event")
    else:
        rest = DecodedPacket(message)
        rest.packet = packet
        return rest
    return None


Send = Callable[[bytes], Sending]


def client_send(client: socketio.AsyncClient) -> Send:
    """Return the function that sends an encoded message to the server."""
    websocket = getattr(client.eio, "ws", None)
    if isinstance(websocket, ClientWebSocketResponse):
        return UnbufferedSend(websocket)
    send: Send = client.eio.send
    return send


class _RepeatFilter(logging.Filter):
    """Suppress lines with which strangers could fill a log.

    The libraries log a line for each broken connection, which the link reports anyway, and a
    traceback for each malformed request or packet. Of the tracebacks, one of each kind passes per
    second; that of a malformed request becomes a sentence.
    """

    def __init__(self) -> None:
        super().__init__()
        self._limit = RepeatLimit()

    def filter(self, record: logging.LogRecord) -> bool:
        if record.exc_info is None or not self._limit.allow(record.msg):
            return False
        error = record.exc_info[1]
        if isinstance(error, HttpProcessingError):
            record.msg, record.args = "malformed request rejected: %s", (type(error).__name__,)
            record.exc_info = None
        return True


def wire_logger() -> logging.Logger:
    """Return the logger for the libraries, which logs only errors, one of each kind a second."""
    logger = logging.getLogger("mmt.link.wire")
    if not logger.filters:
        logger.addFilter(_RepeatFilter())
        logger.setLevel(logging.ERROR)
    return logger
