"""The bounded send queue between a tick that must not wait and a link that may stall.

The kernel and the event loop each buffer hundreds of kilobytes before a send has to wait: seconds
of frames, which a network that recovers delivers before the first new one. `UnbufferedSend`
keeps those buffers short, so that messages wait in the queue instead, where they can be dropped
for newer ones.
"""

import asyncio
import socket
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine, Generator
from contextlib import suppress
from typing import Any, Final, Protocol

from aiohttp import ClientWebSocketResponse, web

Sending = Coroutine[Any, Any, None]

_FLUSH_POLL_S: Final = 0.002


class SendQueue:
    """Send messages in their order; when full, give up the oldest.

    A message goes out as it is put, in the caller's turn of the loop, where the link takes it
    at once, as it does unless it is stalled; waking a task for it would cost about 20 us. What
    the link does not take at once is sent by a task, and what is put meanwhile waits.

    Parameters
    ----------
    capacity
        Messages that may wait.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._begun: tuple[int, bytes, _Begun] | None = None
        self._send: Callable[[bytes], Sending] | None = None
        self._stalled = False
        self._wake = asyncio.Event()
        self._finishing = False
        self._task: asyncio.Task[None] | None = None
        self.messages = self.bytes = self.records = 0
        self.dropped = 0

    @property
    def is_open(self) -> bool:
        """Whether what is put will be sent."""
        return self._task is not None and not self._task.done()

    @property
    def emulated(self) -> dict[str, int]:
        """What an emulated network did to messages; nothing here."""
        return {}

    @property
    def idle(self) -> bool:
        """Whether the link could take a message at once: none waits or is being taken."""
        return self.is_open and not self._waiting and not self._stalled

    def open(self, send: Callable[[bytes], Sending]) -> None:
        """Start to send; closes what was open before.

        Parameters
        ----------
        send
            Takes one message; returns when the link can take the next; raises
            ConnectionError when the link is down, after which nothing more is sent.
        """
        self.close()
        self._finishing = self._stalled = False
        self._send = send
        self._task = asyncio.get_running_loop().create_task(self._run(send))

    def put(self, records: int, message: bytes) -> None:
        """Send or queue a message that holds so many records; never waits."""
        if not self.is_open or self._send is None:
            self.dropped += records
            return
        if not self._stalled:
            self._begin(self._send(message), records, message)
            return
        if len(self._waiting) >= self._capacity:
            self.dropped += self._waiting.popleft()[0]
        self._waiting.append((records, message))

    async def flush(self, timeout_s: float) -> None:
        """Wait until what was put has been sent, for at most this long."""
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while self.is_open and not self._empty:
                    await asyncio.sleep(_FLUSH_POLL_S)

    @property
    def _empty(self) -> bool:
        return self.idle

    async def finish(self, timeout_s: float) -> None:
        """Send what waits, for at most this long, then close."""
        if self._task is not None:
            self._finishing = True
            self._wake.set()
            await asyncio.wait([self._task], timeout=timeout_s)
        self.close()

    def close(self) -> None:
        """Stop sending at once; what still waits counts as dropped."""
        if self._task is not None:
            self._task.cancel()
            self._task = None
        self.dropped += sum(records for records, _ in self._waiting)
        self._waiting.clear()
        if self._begun is not None:
            records, _, begun = self._begun
            self.dropped += records
            begun.close()
            self._begun = None

    def _begin(self, sending: Sending, records: int, message: bytes) -> None:
        """Run a sending as far as it goes without waiting; leave the rest to the task."""
        try:
            awaited = sending.send(None)
        except StopIteration:
            self._count(records, message)
            return
        except Exception as error:  # noqa: BLE001 - raised again in the task
            sending, awaited = _raise(error), None
        self._begun = records, message, _Begun(sending, awaited)
        self._stalled = True
        self._wake.set()

    def _count(self, records: int, message: bytes) -> None:
        self.messages += 1
        self.bytes += len(message)
        self.records += records

    async def _run(self, send: Callable[[bytes], Sending]) -> None:
        while True:
            while self._begun is not None or self._waiting:
                try:
                    await self._send_next(send)
                except ConnectionError:
                    return  # who reads the link finds out, and says so
            if self._finishing:
                return
            self._stalled = False
            self._wake.clear()
            await self._wake.wait()

    async def _send_next(self, send: Callable[[bytes], Sending]) -> None:
        sending: Awaitable[None]
        if self._begun is not None:
            (records, message, sending), self._begun = self._begun, None
        else:
            records, message = self._waiting.popleft()
            sending = send(message)
        try:
            await sending
        except (ConnectionError, asyncio.CancelledError):
            self.dropped += records
            raise
        self._count(records, message)


class _Begun:
    """The rest of a coroutine that was run until it first had to wait.

    Parameters
    ----------
    coroutine
        Which was run.
    awaited
        What it waits for.
    """

    def __init__(self, coroutine: Sending, awaited: Any) -> None:
        self._coroutine = coroutine
        self._awaited = awaited

    def close(self) -> None:
        """Give the coroutine up."""
        self._coroutine.close()

    def __await__(self) -> Generator[Any, Any, None]:
        try:
            yield self._awaited
        except BaseException as error:  # noqa: BLE001 - the coroutine is the one to handle it
            try:
                awaited = self._coroutine.throw(error)
            except StopIteration:
                return
            yield from _Begun(self._coroutine, awaited).__await__()
        else:
            yield from self._coroutine.__await__()


async def _raise(error: Exception) -> None:
    raise error


UNSENT_BYTES: Final = 4096
"""What the kernel takes beyond that which is on its way; some 50 frames."""

_WRITE_POLL_S: Final = 0.001


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
        """Send a message; see `mmt.link.queue.SendQueue.open`."""
        transport = self._transport
        return self._send(message) if transport is None else self._wait(message, transport)

    async def _wait(self, message: bytes, transport: _Transport) -> None:
        await self._send(message)
        while transport.get_write_buffer_size() > 0:
            await asyncio.sleep(_WRITE_POLL_S)


def _transport_of(
    websocket: ClientWebSocketResponse | web.WebSocketResponse,
) -> _Transport | None:
    """Return what the WebSocket writes to, None where this version of aiohttp hides it."""
    transport = getattr(getattr(websocket, "_writer", None), "transport", None)
    return transport if isinstance(transport, asyncio.WriteTransport) else None
