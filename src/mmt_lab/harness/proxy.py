"""A TCP proxy on loopback that can stall, cut and delay what goes through it.

What is read at once is a packet; each meets the fate that `mmt.link.impairments` gives it. TCP
repeats what is lost and keeps the order: a lost packet comes later, after one timeout or several,
and what is behind it waits.
"""

import asyncio
import time
from contextlib import suppress
from typing import Final, Self

from mmt.link.impairments import MessageImpairments
from mmt.scene import Network

_HOST: Final = "127.0.0.1"
_CHUNK: Final = 65_536
_RETRY_NS: Final = 200_000_000
"""The shortest time after which Linux repeats a packet. It is not doubled with each repetition: a
burst of losses counts packets, and the repeated ones would make it last for minutes."""

_Packets = asyncio.Queue[tuple[int, bytes]]
"""When each arrives (ns), and what it holds; an empty one is the end."""


class Proxy:
    """Passes connections on loopback on to a port.

    Parameters
    ----------
    target
        The port that connections are passed on to.
    network
        An emulated network, both ways; by default none.
    seed
        Of the impairments of the first connection's way there; each further way has the next.
    """

    def __init__(self, target: int, network: Network | None = None, seed: int = 1) -> None:
        self._target, self._network, self._seed = target, network or Network(), seed
        self._tasks: set[asyncio.Task[None]] = set()
        self._sinks: set[asyncio.StreamWriter] = set()
        self._server: asyncio.Server | None = None
        self._flowing = asyncio.Event()
        self._flowing.set()
        self.repeated = 0
        """Packets that were lost and sent again."""

    @property
    def port(self) -> int:
        """The port that it listens on."""
        assert self._server is not None  # noqa: S101 - entered
        return int(self._server.sockets[0].getsockname()[1])

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._serve, _HOST, 0)
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._server is not None:
            self._server.close()
        self.cut()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def stall(self) -> None:
        """Pass nothing on; what comes waits, at last in the senders."""
        self._flowing.clear()

    def resume(self) -> None:
        """Pass on what has waited, and all that comes."""
        self._flowing.set()

    def cut(self) -> None:
        """Abort every connection, without a goodbye."""
        for sink in self._sinks:
            sink.transport.abort()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            there, back = await asyncio.open_connection(_HOST, self._target)
        except OSError:  # nobody is there any more
            writer.close()
            return
        for source, sink in ((reader, back), (there, writer)):
            seed = self._seed
            self._seed += 1
            packets: _Packets = asyncio.Queue()
            self._sinks.add(sink)
            for coroutine in (self._take(source, packets, seed), self._give(packets, sink)):
                task = asyncio.create_task(coroutine)
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)

    async def _take(self, source: asyncio.StreamReader, packets: _Packets, seed: int) -> None:
        """Read packets, and let each wait until it arrives."""
        network = MessageImpairments(self._network, seed, time.monotonic_ns())
        sent_ns, chunk = 0, b"-"
        while chunk:
            chunk = b""
            with suppress(ConnectionError):
                chunk = await source.read(_CHUNK)
            await self._flowing.wait()
            sent_ns = max(sent_ns, time.monotonic_ns())
            while not (arrivals := network.arrivals_ns(sent_ns, len(chunk))):
                self.repeated += 1
                sent_ns += _RETRY_NS
            packets.put_nowait((arrivals[0], chunk))

    async def _give(self, packets: _Packets, sink: asyncio.StreamWriter) -> None:
        try:
            while True:
                arrival_ns, chunk = await packets.get()
                wait_ns = arrival_ns - time.monotonic_ns()
                if wait_ns > 0:
                    await asyncio.sleep(1e-9 * wait_ns)
                if not chunk:
                    break
                sink.write(chunk)
                await sink.drain()
        except ConnectionError:
            pass  # the other way is told by its own end
        finally:
            self._sinks.discard(sink)
            sink.close()
            with suppress(ConnectionError):
                await sink.wait_closed()
