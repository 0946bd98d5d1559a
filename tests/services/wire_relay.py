"""A TCP relay between two sides that a test cuts, keeps down, or lets fall silent."""

import asyncio
import contextlib
import socket
from contextlib import asynccontextmanager

_WAITING_BYTES = 4096


class Relay:
    """Passes bytes on while the wire is whole."""

    def __init__(self, target):
        self._target = target
        self._whole = True
        self._flowing = asyncio.Event()
        self._flowing.set()
        self.writers = []
        """Two for each connection."""
        self._tasks = []
        self._server = None
        self.port = 0

    async def open(self):
        """Listen on a free port; what waits here is little, as on a radio link."""
        listening = socket.create_server(("127.0.0.1", 0))
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _WAITING_BYTES)
        self._server = await asyncio.start_server(self._relay, sock=listening, limit=1024)
        self.port = listening.getsockname()[1]

    async def close(self):
        """Cut for good."""
        self._server.close()
        self.cut()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._server.wait_closed()

    def drop(self):
        """Drop every connection."""
        for writer in self.writers:
            writer.transport.abort()
        self.writers.clear()

    def cut(self):
        """Drop every connection and take no new one."""
        self._whole = False
        self.drop()

    def mend(self):
        """Take connections again, and let bytes flow."""
        self._whole = True
        self._flowing.set()

    def fall_silent(self):
        """Hold every byte back; both ends believe that they are connected."""
        self._flowing.clear()

    async def _relay(self, reader, writer):
        try:
            if not self._whole:
                raise ConnectionAbortedError
            far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._target)
        except OSError:
            writer.transport.abort()
            return
        self.writers += [writer, far_writer]
        self._tasks += [
            asyncio.create_task(self._pump(reader, far_writer)),
            asyncio.create_task(self._pump(far_reader, writer)),
        ]

    async def _pump(self, reader, writer):
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(_WAITING_BYTES):
                await self._flowing.wait()
                writer.write(data)
                await writer.drain()
        writer.close()


@asynccontextmanager
async def relay(target):
    """Relay to a port of this machine."""
    made = Relay(target)
    await made.open()
    try:
        yield made
    finally:
        await made.close()
