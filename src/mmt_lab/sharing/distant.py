"""A TCP proxy behind an emulated network.

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


class DistantProxy:
    """Passes connections on loopback on to a port, as if that were far away.

    Parameters
    ----------
    target
        The port that connections are passed on to.
    settings
        The emulated network, both ways.
    seed
        Of the first connection's impairments; each further one has another.
    """

    def __init__(self, target: int, settings: Network, seed: int = 1) -> None:
        self._target, self._settings, self._seed = target, settings, seed
        self._tasks: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None
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
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            there, back = await asyncio.open_connection(_HOST, self._target)
        except OSError:  # the session is over
            writer.close()
            return
        for source, sink in ((reader, back), (there, writer)):
            self._seed += 1
            waiting: asyncio.Queue[tuple[int, bytes]] = asyncio.Queue()
            for coroutine in (self._take(source, waiting), self._give(waiting, sink)):
                task = asyncio.create_task(coroutine)
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)

    async def _take(
        self, source: asyncio.StreamReader, waiting: "asyncio.Queue[tuple[int, bytes]]"
    ) -> None:
        """Read packets, and let each wait until it arrives; an empty one is the end."""
        network = MessageImpairments(self._settings, self._seed, time.monotonic_ns())
        sent_ns, chunk = 0, b"-"
        while chunk:
            chunk = b""
            with suppress(ConnectionError):
                chunk = await source.read(_CHUNK)
            sent_ns = max(sent_ns, time.monotonic_ns())
            while not (arrivals := network.arrivals_ns(sent_ns, len(chunk))):
                self.repeated += 1
                sent_ns += _RETRY_NS
            waiting.put_nowait((arrivals[0], chunk))

    async def _give(
        self, waiting: "asyncio.Queue[tuple[int, bytes]]", sink: asyncio.StreamWriter
    ) -> None:
        try:
            while True:
                arrival_ns, chunk = await waiting.get()
                await asyncio.sleep(max(0.0, 1e-9 * (arrival_ns - time.monotonic_ns())))
                if not chunk:
                    break
                sink.write(chunk)
                await sink.drain()
        except ConnectionError:
            pass  # the other way is told by its own end
        finally:
            sink.close()
            with suppress(ConnectionError):
                await sink.wait_closed()
