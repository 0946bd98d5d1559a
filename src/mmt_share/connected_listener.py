"""Record of a connected listener, for the server of a shared model."""

import asyncio
import time
from dataclasses import dataclass, field
from typing import Any

from mmt.link.websocket import Send
from mmt_share.relay import ListenerFeed


@dataclass
class ConnectedListener:
    """A connected listener; it is served from its first `AGAIN` on."""

    number: int
    name: str
    send: Send
    feed: ListenerFeed
    joined_s: float = field(default_factory=time.monotonic)
    serving: asyncio.Task[None] | None = None
    rejected: int = 0
    why: str = ""
    """Why the server disconnects the listener; empty if it does not."""

    @property
    def text(self) -> str:
        """Name of the listener in messages to people."""
        return f"listener {self.name}" if self.name else "a listener"

    def figures(self) -> dict[str, Any]:
        """Return the figures of the listener for a table."""
        return {
            "id": self.number,
            "name": self.name,
            "listened_s": round(time.monotonic() - self.joined_s, 3),
            **self.feed.figures(time.monotonic_ns()),
            "rejected": self.rejected,
        }

    def reject(self, _: str) -> None:
        """Count a message that could not be used."""
        self.rejected += 1

    def lag_order(self) -> tuple[bool, float]:
        """Return a sort key that grows with the lag; an unknown lag is the lowest."""
        lag_ms = self.feed.lag.last_ms
        return lag_ms is not None, lag_ms or 0.0
