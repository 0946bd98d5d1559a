"""A listener as the server of a shared model knows it."""

import asyncio
import time
from dataclasses import dataclass, field
from typing import Any

from mmt.link.websocket import Send
from mmt_share.relay import ListenerFeed


@dataclass
class ConnectedListener:
    """A listener that is connected; it is served from its first `AGAIN` on."""

    number: int
    name: str
    send: Send
    feed: ListenerFeed
    joined_s: float = field(default_factory=time.monotonic)
    serving: asyncio.Task[None] | None = None
    rejected: int = 0
    why: str = ""
    """Why it is to be let go."""

    @property
    def text(self) -> str:
        """What a person calls it."""
        return f"listener {self.name}" if self.name else "a listener"

    def figures(self) -> dict[str, Any]:
        """Return what is known of it, for a table."""
        return {
            "id": self.number,
            "name": self.name,
            "listened_s": round(time.monotonic() - self.joined_s, 3),
            **self.feed.figures(time.monotonic_ns()),
            "rejected": self.rejected,
        }

    def reject(self, _: str) -> None:
        """Count a message of it that could not be used."""
        self.rejected += 1

    def lag_order(self) -> tuple[bool, float]:
        """Return what grows with how far it is behind, for sorting."""
        lag_ms = self.feed.lag.last_ms
        return lag_ms is not None, lag_ms or 0.0
