"""A TCP proxy between two services that can stall and cut what goes through it."""

import asyncio
from typing import Final, Self

_HOST: Final = "127.0.0.1"


class Proxy:
    """Passes connections on loopback on to a port.

    Parameters
    ----------
    target
        The port that connections are passed on to.
    """

    def __init__(self, target: int) -> None:
        self._target = target
        self._server: asyncio.Server | None = None
        self._ends: set[_End] = set()
        self._stalled = False

    @property
    def port(self) -> int:
        """The port that it listens on."""
        assert self._server is not None  # noqa: S101 - entered
        return int(self._server.sockets[0].getsockname()[1])

    async def __aenter__(self) -> Self:
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(self._accept, _HOST, 0)
        return self

    async def __aexit__(self, *_: object) -> None:
        self.cut()
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()

    def stall(self) -> None:
        """Pass nothing on; what comes waits, at last in the senders."""
        self._stalled = True
        for end in self._ends:
            end.listen(False)

    def resume(self) -> None:
        """Pass on what has waited, and all that comes."""
        self._stalled = False
        for end in self._ends:
            end.listen(True)

    def cut(self) -> None:
        """Abort every connection, without a goodbye."""
        for end in list(self._ends):
            end.abort()

    def _accept(self) -> asyncio.Protocol:
        return _End(self, self._target)

    def add(self, end: "_End") -> None:
        """Take note of one end of a connection.

        Python before 3.11.3 begins to read after this, whatever it was told in the meantime.
        """
        self._ends.add(end)
        asyncio.get_running_loop().call_soon(self._listen, end)

    def _listen(self, end: "_End") -> None:
        end.listen(not self._stalled and end.peer is not None)

    def remove(self, end: "_End") -> None:
        """Forget an end that is gone."""
        self._ends.discard(end)


class _End(asyncio.Protocol):
    """One end of a connection; the accepted one calls for the other."""

    def __init__(self, proxy: Proxy, target: int, peer: "_End | None" = None) -> None:
        self._proxy = proxy
        self._target = target
        self.peer = peer
        self._transport: asyncio.Transport | None = None
        self._calling: asyncio.Task[None] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - of a stream
        self._transport = transport
        if self.peer is not None:
            self.peer.peer = self
            self._proxy.add(self.peer)
        else:
            self._calling = asyncio.create_task(self._call())
        self._proxy.add(self)

    async def _call(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            await loop.create_connection(
                lambda: _End(self._proxy, self._target, self), _HOST, self._target
            )
        except OSError:
            self.abort()

    def data_received(self, data: bytes) -> None:
        if self.peer is not None and self.peer._transport is not None:
            self.peer._transport.write(data)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - of the protocol
        self._proxy.remove(self)
        if self.peer is not None and self.peer._transport is not None:
            self.peer._transport.close()

    def listen(self, wanted: bool) -> None:
        """Take in what comes, or leave it with the operating system."""
        if self._transport is None or self._transport.is_closing():
            return
        if wanted:
            self._transport.resume_reading()
        else:
            self._transport.pause_reading()

    def abort(self) -> None:
        """End the connection at once."""
        if self._transport is not None:
            self._transport.abort()
