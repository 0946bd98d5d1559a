"""A Socket.IO client that costs little, for crowds of them on the machine that serves them too.

The library's client takes several tasks and timers for each message. A thousand of them would keep
both processors of a small machine busy, and what is measured would be they.
"""

import asyncio
import base64
import os
import struct
from collections.abc import Callable, Mapping
from typing import Any, Final
from urllib.parse import urlsplit

import msgpack

from mmt.link.protocol import CONNECT_PACKET, EVENT_NAMESPACE, MSGPACK_EVENT, encode_event
from mmt.link.websocket import LINK_PATH

_CONNECT_ERROR: Final = 4
"""Type of a Socket.IO packet that refuses a connection."""
_TEXT, _BINARY, _CLOSE = 1, 2, 8
"""WebSocket opcodes."""
_PING, _PONG = b"2", b"3"
"""Engine.IO packets."""
_UNMASKED: Final = bytes(4)
"""A client must mask what it sends; this mask changes nothing."""
_LENGTHS: Final = {126: struct.Struct(">H"), 127: struct.Struct(">Q")}


class PlainSocket(asyncio.Protocol):
    """One connection, of Engine.IO 4 over a WebSocket without TLS, with the msgpack serializer.

    Parameters
    ----------
    on_event
        Called with each event's name and argument.
    on_lost
        Called when the connection has ended, by whomever.
    """

    def __init__(self, on_event: Callable[[str, Any], None], on_lost: Callable[[], None]) -> None:
        self._on_event, self._on_lost = on_event, on_lost
        self._transport: asyncio.Transport | None = None
        self._auth: Mapping[str, Any] = {}
        self._upgraded = False
        self._rest = b""
        self._opened: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    async def open(self, url: str, auth: Mapping[str, Any], timeout_s: float) -> str:
        """Connect; return an empty text, or why it was not possible."""
        self._auth = auth
        parts = urlsplit(url)
        try:
            async with asyncio.timeout(timeout_s):
                await asyncio.get_running_loop().create_connection(
                    lambda: self, parts.hostname or "", parts.port or 80
                )
                key = base64.b64encode(os.urandom(16)).decode()
                self._write(
                    f"GET {LINK_PATH}?EIO=4&transport=websocket HTTP/1.1\r\n"
                    f"Host: {parts.netloc}\r\n"
                    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                    f"Sec-WebSocket-Key: {key}\r\n\r\n".encode()
                )
                return await self._opened
        except (OSError, TimeoutError) as error:
            self.close()
            return str(error) or f"no answer within {timeout_s:g} s"

    def emit(self, event: str, argument: object) -> None:
        """Send an event."""
        self._send(_BINARY, encode_event(event, argument))

    def close(self) -> None:
        """Leave."""
        if self._transport is not None:
            self._transport.close()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the transport."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - of a TCP connection
        self._transport = transport

    def connection_lost(self, error: Exception | None) -> None:
        """Tell that it has ended."""
        if not self._opened.done():
            self._opened.set_result(str(error or "the connection was closed"))
        self._on_lost()

    def data_received(self, data: bytes) -> None:
        """Take what comes."""
        data = self._rest + data if self._rest else data
        place = 0
        if not self._upgraded:
            place = data.find(b"\r\n\r\n") + 4
            if place < 4:
                self._rest = data
                return
            if not data.startswith(b"HTTP/1.1 101"):
                self._refuse(data[:60].decode(errors="replace"))
                return
            self._upgraded = True
        while (frame := _frame(data, place)) is not None:
            opcode, payload, place = frame
            self._take(opcode, payload)
        self._rest = data[place:]

    def _take(self, opcode: int, payload: bytes) -> None:
        if opcode == _BINARY:
            packet = msgpack.unpackb(payload)
            if packet["type"] == MSGPACK_EVENT:
                self._on_event(*packet["data"])
            elif packet["type"] == CONNECT_PACKET and not self._opened.done():
                self._opened.set_result("")
            elif packet["type"] == _CONNECT_ERROR:
                self._refuse(str(packet["data"]["message"]))
        elif opcode == _CLOSE:
            self.close()
        elif payload == _PING:
            self._send(_TEXT, _PONG)
        elif payload.startswith(b"0"):  # Engine.IO is open
            packet = {"type": CONNECT_PACKET, "data": dict(self._auth), "nsp": EVENT_NAMESPACE}
            self._send(_BINARY, msgpack.packb(packet))

    def _refuse(self, why: str) -> None:
        if not self._opened.done():
            self._opened.set_result(why)
        self.close()

    def _send(self, opcode: int, payload: bytes) -> None:
        length = len(payload)
        if length < 126:
            head = bytes((0x80 | opcode, 0x80 | length))
        else:
            head = struct.pack(">BBH", 0x80 | opcode, 0x80 | 126, length)
        self._write(head + _UNMASKED + payload)

    def _write(self, data: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)


def _frame(data: bytes, place: int) -> tuple[int, bytes, int] | None:
    """Return the opcode and the payload of the frame there and where the next one is."""
    if len(data) < place + 2:
        return None
    opcode, length = data[place] & 0x0F, data[place + 1]
    place += 2
    if length in _LENGTHS:
        kind = _LENGTHS[length]
        if len(data) < place + kind.size:
            return None
        (length,) = kind.unpack_from(data, place)
        place += kind.size
    end = place + length
    return None if len(data) < end else (opcode, data[place:end], end)
