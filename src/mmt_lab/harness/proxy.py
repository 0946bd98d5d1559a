"""A TCP proxy on loopback that can stall and cut its connections."""

import asyncio
from contextlib import suppress
from typing import Final, Self

from mmt.core.running.ending import start_task

_HOST: Final = "127.0.0.1"
_CHUNK: Final = 65_536


class Proxy:
    """Forwards loopback connections to a port.

    Parameters
    ----------
    target
        The port to which connections are forwarded.
    """

    def __init__(self, target: int) -> None:
        self._target = target
        self._tasks: set[asyncio.Task[None]] = set()
        self._sinks: set[asyncio.StreamWriter] = set()
        self._server: asyncio.Server | None = None
        self._flowing = asyncio.Event()
        self._flowing.set()

    @property
    def port(self) -> int:
        """The port on which the proxy listens."""
        assert self._server is not None  # noqa: S101 - entered
        return int(self._server.sockets[0].getsockname()[1])

    async def __aenter__(self) -> Self:
        self._server = await self.listen()
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._server is not None:
            self._server.close()
        self.cut()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def listen(self) -> asyncio.Server:
        """Return a server of connections on a free port."""
        return await asyncio.start_server(self.serve, _HOST, 0)

    def stall(self) -> None:
        """Forward nothing; data waits in buffers, and finally in the senders."""
        self._flowing.clear()

    def resume(self) -> None:
        """Forward the data that has waited, and all that follows."""
        self._flowing.set()

    def cut(self) -> None:
        """Abort every connection without a closing handshake."""
        for sink in self._sinks:
            sink.transport.abort()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Forward a connection both ways."""
        try:
            there, back = await asyncio.open_connection(_HOST, self._target)
        except OSError:  # the target no longer listens
            writer.close()
            return
        for source, sink in ((reader, back), (there, writer)):
            self._sinks.add(sink)
            start_task(self._pass_on(source, sink), self._tasks)

    async def _pass_on(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        try:
            while True:
                chunk = await source.read(_CHUNK)
                await self._flowing.wait()
                if not chunk:
                    break
                sink.write(chunk)
                await sink.drain()
        except ConnectionError:
            pass  # the task of the other direction notices by itself
        finally:
            self._sinks.discard(sink)
            sink.close()
            with suppress(ConnectionError):
                await sink.wait_closed()
