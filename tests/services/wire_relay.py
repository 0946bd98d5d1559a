"""A TCP relay between two sides that a test cuts, keeps down, or lets fall silent."""

import asyncio
import socket

from mmt_lab.harness.proxy import Proxy

_WAITING_BYTES = 4096


class Wire(Proxy):
    """Passes bytes on to a port of this machine while it is whole and not stalled."""

    connections = 0
    """How many there have been."""
    is_whole = True

    async def listen(self):
        """What waits here is little, as on a radio link."""
        listening = socket.create_server(("127.0.0.1", 0))
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _WAITING_BYTES)
        return await asyncio.start_server(self.serve, sock=listening, limit=1024)

    def keep_down(self):
        """Drop every connection and take no new one."""
        self.is_whole = False
        self.cut()

    def mend(self):
        """Take connections again, and let bytes flow."""
        self.is_whole = True
        self.resume()

    async def serve(self, reader, writer):
        if self.is_whole:
            self.connections += 1
            await super().serve(reader, writer)
        else:
            writer.transport.abort()
