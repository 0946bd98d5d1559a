"""Let no backlog grow between us and a network that has stalled.

The kernel and the event loop each take hundreds of kilobytes before a send has to wait: seconds
of frames, which a network that lets go delivers before the first new one. What waits in the
outbox instead can be given up for something newer.
"""

import asyncio
import socket
from typing import Final, Protocol

from aiohttp import ClientWebSocketResponse, web

from mmt.link.outbox import Sending

UNSENT_BYTES: Final = 4096
"""What the kernel takes beyond that which is on its way; some 50 frames."""

_POLL_S: Final = 0.001


class _Transport(Protocol):
    def get_write_buffer_size(self) -> int:
        """Return how many bytes the event loop holds."""


class UnbufferedSend:
    """Send over a WebSocket, and wait while its bytes do not leave for the kernel.

    Parameters
    ----------
    websocket
        That is open.
    """

    def __init__(self, websocket: ClientWebSocketResponse | web.WebSocketResponse) -> None:
        self._send = websocket.send_bytes
        self._transport = _transport_of(websocket)
        option = getattr(socket, "TCP_NOTSENT_LOWAT", None)
        connection = websocket.get_extra_info("socket")
        if option is not None and connection is not None:
            connection.setsockopt(socket.IPPROTO_TCP, option, UNSENT_BYTES)

    def __call__(self, message: bytes) -> Sending:
        """Send a message; see `mmt.link.outbox.Outbox.open`."""
        transport = self._transport
        return self._send(message) if transport is None else self._wait(message, transport)

    async def _wait(self, message: bytes, transport: _Transport) -> None:
        await self._send(message)
        while transport.get_write_buffer_size() > 0:
            await asyncio.sleep(_POLL_S)


def _transport_of(
    websocket: ClientWebSocketResponse | web.WebSocketResponse,
) -> _Transport | None:
    """Return what the WebSocket writes to, None where this version of aiohttp hides it."""
    transport = getattr(getattr(websocket, "_writer", None), "transport", None)
    return transport if isinstance(transport, asyncio.WriteTransport) else None
