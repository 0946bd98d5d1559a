"""What listeners are to have, and who of them has what.

Every message is made once. A listener has room for no queue: when it can take the next message, it
gets what is newest by then. So a slow one skips states, the memory does not grow, and nobody waits
for anybody.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

from mmt.link.protocol import encode_event
from mmt.sharing.messages import END

_KINDS: Final = ("wholes", "changes", "states")

STALLED_S: Final = 10.0
"""A listener that takes no message for this long is let go."""


class Relay:
    """The newest messages, and the listeners that they are for."""

    def __init__(self) -> None:
        self.number = 0
        """Number of the model."""
        self.whole: bytes | None = None
        self.change: bytes | None = None
        self.states = 0
        """Number of the newest state of the hand."""
        self.state: bytes | None = None
        self.end: bytes | None = None
        self.listeners: dict[str, Listener] = {}
        self.sent = dict.fromkeys((*_KINDS, *(f"{kind}_bytes" for kind in _KINDS)), 0)
        """Messages that all listeners have been given, together, and their bytes, by kind."""

    def offer_model(self, number: int, whole: bytes, change: bytes | None) -> None:
        """Let every listener have a new state of the model."""
        self.number, self.whole, self.change = number, whole, change
        self._tell()

    def offer_state(self, message: bytes) -> None:
        """Let every listener have a new state of the hand."""
        self.states, self.state = self.states + 1, message
        self._tell()

    def finish(self, outcome: str) -> None:
        """Let every listener know that the session is over."""
        self.end = encode_event(END, {"outcome": outcome})
        self._tell()

    def _tell(self) -> None:
        for listener in self.listeners.values():
            listener.news.set()


class Listener:
    """One who listens: which messages it has, and which is next.

    Parameters
    ----------
    relay
        Has the messages.
    """

    def __init__(self, relay: Relay) -> None:
        self._relay = relay
        self._number = self._states = 0
        self._ended = False
        self.news = asyncio.Event()
        self.news.set()

    def again(self) -> None:
        """Let it have the whole model next."""
        self._number = 0
        self.news.set()

    def next(self) -> bytes | None:
        """Return the next message, None where it has all."""
        relay = self._relay
        if relay.number != self._number:
            follows = self._number == relay.number - 1 and relay.change is not None
            self._number = relay.number
            if follows:
                return self._given("changes", relay.change)
            return self._given("wholes", relay.whole)
        if relay.states != self._states:
            self._states = relay.states
            return self._given("states", relay.state)
        if relay.end is not None and not self._ended:
            self._ended = True
            return relay.end
        return None

    def _given(self, kind: str, message: bytes | None) -> bytes | None:
        """Count a message that is given to it."""
        sent = self._relay.sent
        sent[kind] += 1
        sent[f"{kind}_bytes"] += len(message or b"")
        return message

    async def serve(self, send: Callable[[bytes], Awaitable[None]]) -> None:
        """Send what is newest, until the session is over.

        Raises
        ------
        ConnectionError
            It has gone.
        TimeoutError
            It has taken no message for `STALLED_S`.
        """
        while not self._ended:
            await self.news.wait()
            self.news.clear()
            while (message := self.next()) is not None:
                async with asyncio.timeout(STALLED_S):
                    await send(message)
