"""The bounded send queue between a tick that must not wait and a link that may stall.

The kernel and the event loop each buffer hundreds of kilobytes before a send has to wait. These
are seconds of frames, which a recovering network delivers before the first new one.
`UnbufferedSend` keeps those buffers short, so that messages wait in the queue instead, which can
drop them for newer ones.
"""

import asyncio
import socket
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine, Generator
from contextlib import suppress
from typing import Any, Final

from aiohttp import ClientWebSocketResponse, web

from mmt.link.protocol import MAX_RECORDS_PER_MESSAGE, encode_event

Sending = Coroutine[Any, Any, None]

_FLUSH_POLL_S: Final = 0.002


class SendQueue:
    """A bounded first-in, first-out queue of messages; when full, the oldest is dropped.

    Unless the link is stalled, a message is sent within `put`, in the caller's turn of the event
    loop: waking a task for it would cost about 20 us. A send that has to wait is finished by a
    task, and messages put meanwhile are queued.

    Parameters
    ----------
    capacity
        Length of the queue (messages).
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._waiting: deque[tuple[int, bytes]] = deque()
        self._suspended: tuple[int, bytes, SuspendedSend] | None = None
        self._send: Callable[[bytes], Sending] | None = None
        self._stalled = False
        self._wake = asyncio.Event()
        self._finishing = False
        self._task: asyncio.Task[None] | None = None
        self.messages = self.bytes = self.records = 0
        self.dropped = 0

    @property
    def is_open(self) -> bool:
        """Whether messages that are put will be sent."""
        return self._task is not None and not self._task.done()

    @property
    def emulated(self) -> dict[str, int]:
        """Counts of an emulated network; empty without one."""
        return {}

    @property
    def idle(self) -> bool:
        """Whether a message could be sent at once: none is queued or being sent."""
        return self.is_open and not self._waiting and not self._stalled

    def open(self, send: Callable[[bytes], Sending]) -> None:
        """Start to send; an earlier connection is closed first.

        Parameters
        ----------
        send
            Sends one message; returns when the link is ready for the next one; raises
            ConnectionError when the link is down, after which nothing more is sent.
        """
        self.close()
        self._finishing = self._stalled = False
        self._send = send
        self._task = asyncio.get_running_loop().create_task(self._run(send))

    def put(self, records: int, message: bytes) -> None:
        """Send or queue a message that holds this many records; never waits."""
        if not self.is_open or self._send is None:
            self.dropped += records
            return
        if not self._stalled:
            self._begin(self._send(message), records, message)
            return
        if len(self._waiting) >= self._capacity:
            self.dropped += self._waiting.popleft()[0]
        self._waiting.append((records, message))

    def put_records(self, event: str, data: bytes, size: int) -> None:
        """Put records of `size` bytes each, in messages of at most 100 records."""
        for start in range(0, len(data), MAX_RECORDS_PER_MESSAGE * size):
            part = data[start : start + MAX_RECORDS_PER_MESSAGE * size]
            self.put(len(part) // size, encode_event(event, part))

    async def flush(self, timeout_s: float) -> None:
        """Wait until the queue is empty, at most `timeout_s`."""
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while self.is_open and not self._empty:
                    await asyncio.sleep(_FLUSH_POLL_S)

    @property
    def _empty(self) -> bool:
        return self.idle

    async def finish(self, timeout_s: float) -> None:
        """Send all queued messages, for at most `timeout_s`, then close."""
        if self._task is not None:
            self._finishing = True
            self._wake.set()
            await asyncio.wait([self._task], timeout=timeout_s)
        self.close()

    def close(self) -> None:
        """Stop sending at once; messages still queued count as dropped."""
        if self._task is not None:
            if not self._task.done():  # cancelling a failed task would hide its error
                self._task.cancel()
            self._task = None
        self.dropped += sum(records for records, _ in self._waiting)
        self._waiting.clear()
        if self._suspended is not None:
            records, _, suspended = self._suspended
            self.dropped += records
            suspended.close()
            self._suspended = None

    def _begin(self, sending: Sending, records: int, message: bytes) -> None:
        """Run the send until it first has to wait; leave the rest to the task."""
        suspended = begin_send(sending)
        if suspended is None:
            self._count(records, message)
            return
        self._suspended = records, message, suspended
        self._stalled = True
        self._wake.set()

    def _count(self, records: int, message: bytes) -> None:
        self.messages += 1
        self.bytes += len(message)
        self.records += records

    async def _run(self, send: Callable[[bytes], Sending]) -> None:
        while True:
            while self._suspended is not None or self._waiting:
                try:
                    await self._send_next(send)
                except ConnectionError:
                    return  # the link's reader notices and reports the break
            if self._finishing:
                return
            self._stalled = False
            self._wake.clear()
            await self._wake.wait()

    async def _send_next(self, send: Callable[[bytes], Sending]) -> None:
        sending: Awaitable[None]
        if self._suspended is not None:
            (records, message, sending), self._suspended = self._suspended, None
        else:
            records, message = self._waiting.popleft()
            sending = send(message)
        try:
            await sending
        except (ConnectionError, asyncio.CancelledError):
            self.dropped += records
            raise
        self._count(records, message)


def begin_send(sending: Sending) -> "SuspendedSend | None":
    """Run a send until it first has to wait, without a task.

    Returns the rest of the send, for a task to await, or None if the send is complete. An error is
    raised when the rest is awaited.
    """
    try:
        awaited = sending.send(None)
    except StopIteration:
        return None
    except Exception as error:  # noqa: BLE001 - raised again in the task
        return SuspendedSend(_raise(error), None)
    return SuspendedSend(sending, awaited)


class SuspendedSend:
    """The rest of a send that was run up to its first wait.

    Parameters
    ----------
    coroutine
        The coroutine.
    awaited
        The object that it waits for.
    """

    def __init__(self, coroutine: Sending, awaited: Any) -> None:
        self._coroutine = coroutine
        self._awaited = awaited

    def close(self) -> None:
        """Abandon the coroutine."""
        self._coroutine.close()

    def __await__(self) -> Generator[Any, Any, None]:
        try:
            yield self._awaited
        except BaseException as error:  # noqa: BLE001 - the coroutine handles it
            try:
                awaited = self._coroutine.throw(error)
            except StopIteration:
                return
            yield from SuspendedSend(self._coroutine, awaited).__await__()
        else:
            yield from self._coroutine.__await__()


async def _raise(error: Exception) -> None:
    raise error


UNSENT_BYTES: Final = 4096
"""Bytes that the kernel buffers beyond those in flight; some 50 frames, or 20 of the largest."""

_WRITE_POLL_S: Final = 0.001


class UnbufferedSend:
    """Send over a WebSocket, and wait until the kernel has taken the bytes.

    Parameters
    ----------
    websocket
        An open WebSocket.
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

    async def _wait(self, message: bytes, transport: asyncio.WriteTransport) -> None:
        await self._send(message)
        while transport.get_write_buffer_size() > 0:
            await asyncio.sleep(_WRITE_POLL_S)


def _transport_of(
    websocket: ClientWebSocketResponse | web.WebSocketResponse,
) -> asyncio.WriteTransport | None:
    """Return the WebSocket's transport, or None if this version of aiohttp hides it."""
    transport = getattr(getattr(websocket, "_writer", None), "transport", None)
    return transport if isinstance(transport, asyncio.WriteTransport) else None
