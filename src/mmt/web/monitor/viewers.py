"""Viewers of the monitor; publishing a message never blocks.

A viewer's queue holds one message of each kind. A newer message replaces one that was not sent
yet, so a slow viewer skips states; it neither delays other viewers nor fills the memory.
"""

import asyncio
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from aiohttp import web

MOST_VIEWERS: Final = 8
"""Largest number of viewers at once."""


class Viewer:
    """Queue of messages to one browser."""

    def __init__(self) -> None:
        self._waiting: dict[str, bytes] = {}
        self._news = asyncio.Event()
        self._closing = False

    def offer(self, kind: str, message: bytes) -> None:
        """Queue a message, replacing an older one of its kind; never blocks."""
        self._waiting[kind] = message
        self._news.set()

    def close(self) -> None:
        """Send the queued messages, then stop."""
        self._closing = True
        self._news.set()

    async def send(self, socket: "web.WebSocketResponse") -> None:
        """Send messages until `close`.

        Raises
        ------
        ConnectionError
            The other side has disconnected.
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
    """All viewers of a session.

    Attributes
    ----------
    retained
        The newest message of each kind that a new viewer needs, in order of first publication.
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
        """Queue a message for all viewers; with `retain` also for later ones."""
        if retain:
            self.retained[kind] = message
        for viewer in self._viewers:
            viewer.offer(kind, message)

    def add(self) -> Viewer:
        """Return a new viewer with the retained messages in its queue."""
        viewer = Viewer()
        self._viewers.add(viewer)
        for kind, message in self.retained.items():
            viewer.offer(kind, message)
        return viewer

    def remove(self, viewer: Viewer) -> None:
        """Remove a viewer that has disconnected."""
        self._viewers.discard(viewer)

    def close(self) -> None:
        """Send all queued messages, and admit no further viewers."""
        self.ended = True
        for viewer in self._viewers:
            viewer.close()
