"""A light Socket.IO client, for crowds of clients on the machine of the server.

The library's client uses several tasks and timers for each message. A thousand such clients would
keep both processors of a small machine busy, and dominate what is measured.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final

import aiohttp
import msgpack

from mmt.link.protocol import CONNECT_PACKET, EVENT_NAMESPACE, MSGPACK_EVENT, encode_event
from mmt.link.websocket import LINK_PATH

_CONNECT_ERROR: Final = 4
"""Type of a Socket.IO packet that refuses a connection."""
_PING, _PONG = "2", "3"
"""Engine.IO packets."""


class PlainSocket:
    """One connection, of Engine.IO 4 over a WebSocket with the msgpack serializer."""

    def __init__(
        self, on_event: Callable[..., Awaitable[None]], on_lost: Callable[[], None]
    ) -> None:
        self._on_event, self._on_lost = on_event, on_lost
        self._http = aiohttp.ClientSession()
        self._socket: aiohttp.ClientWebSocketResponse | None = None
        self._reading: asyncio.Task[None] | None = None

    async def open(self, url: str, auth: Mapping[str, Any], timeout_s: float) -> str:
        """Connect; return an empty string, or the reason if that was not possible."""
        try:
            async with asyncio.timeout(timeout_s):
                address = f"{url}{LINK_PATH}?EIO=4&transport=websocket"
                self._socket = await self._http.ws_connect(address, max_msg_size=0)
                await self._socket.receive()  # Engine.IO is open
                packet = {"type": CONNECT_PACKET, "data": dict(auth), "nsp": EVENT_NAMESPACE}
                await self._socket.send_bytes(msgpack.packb(packet))
                answer = msgpack.unpackb(await self._socket.receive_bytes())
        except (aiohttp.ClientError, OSError, TimeoutError, TypeError) as error:
            return str(error) or f"no answer within {timeout_s:g} s"
        if answer["type"] == _CONNECT_ERROR:
            return str(answer["data"]["message"])
        self._reading = asyncio.create_task(self._read(self._socket))
        return ""

    async def emit(self, event: str, argument: object) -> None:
        """Send an event."""
        if self._socket is not None and not self._socket.closed:
            await self._socket.send_bytes(encode_event(event, argument))

    async def close(self) -> None:
        """Close the connection."""
        if self._reading is not None:
            self._reading.cancel()
            await asyncio.gather(self._reading, return_exceptions=True)
        if self._socket is not None:
            await self._socket.close()
        await self._http.close()

    async def _read(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        async for message in socket:
            if message.type == aiohttp.WSMsgType.BINARY:
                packet = msgpack.unpackb(message.data)
                if packet["type"] == MSGPACK_EVENT:
                    await self._on_event(*packet["data"])
            elif message.data == _PING:
                await socket.send_str(_PONG)
        self._on_lost()
