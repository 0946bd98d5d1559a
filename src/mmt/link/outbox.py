"""The bounded queue between a tick that must not wait and a link that may."""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable


class Outbox:
    """Send messages in their order from one task; when full, give up the oldest.

    Parameters
    ----------
    capacity
        Messages that may wait.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._waiting: deque[tuple[int, bytes]] = deque()
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

    def open(self, send: Callable[[bytes], Awaitable[None]]) -> None:
        """Start to send; closes what was open before.

        Parameters
        ----------
        send
            Takes one message; returns when the link can take the next; raises
            ConnectionError when the link is down, after which nothing more is sent.
        """
        self.close()
        self._finishing = False
        self._task = asyncio.get_running_loop().create_task(self._run(send))

    def put(self, records: int, message: bytes) -> None:
        """Queue a message that holds so many records; never waits."""
        if not self.is_open:
            self.dropped += records
            return
        if len(self._waiting) >= self._capacity:
            self.dropped += self._waiting.popleft()[0]
        self._waiting.append((records, message))
        self._wake.set()

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

    async def _run(self, send: Callable[[bytes], Awaitable[None]]) -> None:
        while True:
            while self._waiting:
                records, message = self._waiting.popleft()
                try:
                    await send(message)
                except (ConnectionError, asyncio.CancelledError) as error:
                    self.dropped += records
                    if isinstance(error, ConnectionError):
                        return  # who reads the link finds out, and says so
                    raise
                self.messages += 1
                self.bytes += len(message)
                self.records += records
            if self._finishing:
                return
            self._wake.clear()
            await self._wake.wait()
