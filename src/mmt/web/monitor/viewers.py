"""The viewers: every message is made once, and waits for none of them.

A viewer has room for one message of each kind. A newer one takes the place of one that was
not sent yet, so that a slow viewer skips states and neither the memory nor the others grow
or wait.
"""

import asyncio
from contextlib import suppress
from typing import Final, Protocol

MOST_VIEWERS: Final = 8
"""That may look on at once."""


class ViewerSocket(Protocol):
    """The part of a WebSocket that a viewer needs."""

    async def send_bytes(self, data: bytes) -> None:
        """Send a message, waiting as long as the other side takes."""


class Viewer:
    """One browser's messages that wait to be sent."""

    def __init__(self) -> None:
        self._waiting: dict[str, bytes] = {}
        self._news = asyncio.Event()
        self._closing = False
        self.skipped = 0
        """Messages whose place a newer one took."""

    def offer(self, kind: str, message: bytes) -> None:
        """Let a message wait in the place of an older one of its kind; never blocks."""
        if kind in self._waiting:
            self.skipped += 1
        self._waiting[kind] = message
        self._news.set()

    def close(self) -> None:
        """Send what waits, and no more."""
        self._closing = True
        self._news.set()

    async def send(self, socket: ViewerSocket) -> None:
        """Send messages until `close`.

        Raises
        ------
        ConnectionError
            The other side has gone.
        """
        while True:
            await self._news.wait()
            self._news.clear()
            while self._waiting:
                kind = next(iter(self._waiting))
                await socket.send_bytes(self._waiting.pop(kind))
            if self._closing:
                return


class Viewers:
    """All who look on.

    Attributes
    ----------
    retained
        The newest message of each kind that a new viewer needs, in the order of their making.
    """

    def __init__(self) -> None:
        self._viewers: set[Viewer] = set()
        self.retained: dict[str, bytes] = {}
        self.ended = False

    def __len__(self) -> int:
        return len(self._viewers)

    @property
    def full(self) -> bool:
        """Whether no further viewer is admitted."""
        return self.ended or len(self._viewers) >= MOST_VIEWERS

    def publish(self, kind: str, message: bytes, *, retain: bool = True) -> None:
        """Offer a message to all; `retain` it for those who come later."""
        if retain:
            self.retained[kind] = message
        for viewer in self._viewers:
            viewer.offer(kind, message)

    def add(self) -> Viewer:
        """Return a new viewer, which is offered the retained messages."""
        viewer = Viewer()
        self._viewers.add(viewer)
        for kind, message in self.retained.items():
            viewer.offer(kind, message)
        return viewer

    def remove(self, viewer: Viewer) -> None:
        """Forget a viewer who has left."""
        with suppress(KeyError):
            self._viewers.remove(viewer)

    def close(self) -> None:
        """Let every viewer have what waits, and admit no more."""
        self.ended = True
        for viewer in self._viewers:
            viewer.close()
