"""A connection, which may send only little, and slowly, before it has shown the token."""

import asyncio
from typing import Final

from aiohttp import web

BYTES: Final = 100_000
"""Most bytes that a connection may send before admission; the longest hello has two thirds."""
_SLICE: Final = 4096
"""Bytes passed on at once: aiohttp takes at most a few tenths of a millisecond for them."""
_PERIOD_S: Final = 0.001
"""Time between two slices of a connection."""


class Gate(asyncio.Protocol):
    """Passes a connection's data to its protocol slowly, until the connection is admitted.

    Parameters
    ----------
    protocol
        The connection's protocol.
    """

    def __init__(self, protocol: web.RequestHandler) -> None:
        self._protocol = protocol
        self._transport: asyncio.Transport | None = None
        self._left = BYTES
        self._waiting = bytearray()
        self._timer: asyncio.TimerHandle | None = None

    def open(self) -> None:
        """Give the transport to the protocol itself, and pass on the waiting data."""
        if self._transport is not None and self._transport.get_protocol() is self:
            self._transport.set_protocol(self._protocol)
            self._stop()
            if self._waiting:
                self._protocol.data_received(bytes(self._waiting))

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the transport."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - of TCP or TLS
        self._transport = transport
        self._protocol.connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Take bytes, or close the connection if they are too many."""
        self._left -= len(data)
        self._waiting += data
        if self._left < 0:
            self._stop()
            if self._transport is not None:
                self._transport.abort()
        elif self._timer is None:
            self._feed()

    def eof_received(self) -> None:
        """Pass on the end; data that still waits is of no use to a client that has left."""
        self._protocol.eof_received()

    def pause_writing(self) -> None:
        """Pass on the call."""
        self._protocol.pause_writing()

    def resume_writing(self) -> None:
        """Pass on the call."""
        self._protocol.resume_writing()

    def connection_lost(self, error: Exception | None) -> None:
        """Stop feeding the protocol, and pass on the loss."""
        self._stop()
        self._protocol.connection_lost(error)

    def _feed(self) -> None:
        piece = bytes(self._waiting[:_SLICE])
        del self._waiting[:_SLICE]
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(_PERIOD_S, self._feed) if self._waiting else None
        self._protocol.data_received(piece)

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
