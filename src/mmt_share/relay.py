"""The newest messages for listeners, and which of them each listener has.

Each message is encoded once, and one task sends it to all listeners that are ready: to wake a task
for each listener costs several times as much as to send. Listeners have no queues: a listener that
is ready for the next message gets the newest one. So a slow listener skips states, memory does not
grow, and no listener waits for another.
"""

import asyncio
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from mmt.link.incoming import PeriodLimit
from mmt.link.protocol import encode_event
from mmt.link.queue import Sending, SuspendedSend, begin_send
from mmt.link.websocket import Send
from mmt_share.lag import FIRST_ANSWERS, Lag, ListenerState
from mmt_share.messages import END

_KINDS: Final = ("wholes", "changes", "states")
_BYTES_OF: Final = {kind: f"{kind}_bytes" for kind in _KINDS}
_REMEMBERED: Final = 600
"""States whose time of making is kept: half a minute of them."""

_OWN_MESSAGES: Final = 20
_TURN: Final = 64
"""Listeners that are served before the event loop runs its other tasks; takes some 1 ms."""
STALLED_S: Final = 10.0
"""A listener that takes no message for this long is disconnected."""


class Relay:
    """The newest messages, and the listeners that they are for."""

    def __init__(self) -> None:
        self.number = 0
        """Number of the newest state of the model."""
        self._whole: bytes | Callable[[], bytes] | None = None
        self.change: bytes | None = None
        self.states = 0
        """Number of the newest state of the hand."""
        self.state: bytes | None = None
        self.end: bytes | None = None
        self.listeners: dict[str, ListenerFeed] = {}
        self.sent = dict.fromkeys((*_KINDS, *_BYTES_OF.values(), "skipped"), 0)
        """Totals of all listeners: messages sent and their bytes, by kind, and messages skipped."""
        self._made_ns: OrderedDict[float, int | None] = OrderedDict()
        self._news = False
        self._giving: asyncio.Task[None] | None = None

    @property
    def whole_model(self) -> bytes | None:
        """The message of the whole model, or None before the first."""
        if callable(self._whole):
            self._whole = self._whole()
        return self._whole

    def offer_model(
        self, number: int, whole: bytes | Callable[[], bytes], change: bytes | None
    ) -> None:
        """Offer a new state of the model to every listener.

        Parameters
        ----------
        number
            Number of this state.
        whole
            Message of the whole model, or a function that makes it when a listener needs it.
        change
            Message of the change from the state before, or None if there is none.
        """
        self.number, self._whole, self.change = number, whole, change
        self._notify_listeners()

    def begin(self) -> None:
        """Begin another session: forget the model and the end, since numbers begin anew."""
        self.number, self._whole, self.change = 0, None, None
        self.end = None
        for listener in self.listeners.values():
            listener.restart()

    def offer_state(self, message: bytes, time_s: float, made_ns: int) -> None:
        """Offer a new state of the hand to every listener.

        Parameters
        ----------
        message
            Encoded message.
        time_s, made_ns
            Session time of the state, and when it was made by this machine's monotonic clock.
        """
        self.states, self.state = self.states + 1, message
        # before the first frame the session time stands still: states of one time are ambiguous
        self._made_ns[time_s] = None if time_s in self._made_ns else made_ns
        if len(self._made_ns) > _REMEMBERED:
            self._made_ns.popitem(last=False)
        self._notify_listeners()

    def made_ns(self, time_s: float) -> int | None:
        """Return when the state of this session time was made, or None if that is not known."""
        return self._made_ns.get(time_s)

    def finish(self, outcome: str) -> None:
        """Tell every listener that the session is over."""
        self.end = encode_event(END, {"outcome": outcome})
        self._notify_listeners()

    def _notify_listeners(self) -> None:
        self._news = True
        if self.listeners and self._giving is None:
            self._giving = asyncio.get_running_loop().create_task(self._send_newest())

    async def _send_newest(self) -> None:
        """Send the newest messages to all listeners, again while new ones have come meanwhile."""
        try:
            while self._news:
                self._news = False
                for place, listener in enumerate(tuple(self.listeners.values()), 1):
                    listener.send_newest()
                    if place % _TURN == 0:
                        await asyncio.sleep(0)
        finally:
            self._giving = None


class ListenerFeed:
    """Choose and send the messages for one listener.

    Parameters
    ----------
    relay
        Holds the messages.
    states_hz
        Most states of the hand that the listener wants in a second, or None for all. The first
        eight come at the full rate, so that its lag is soon known.
    """

    def __init__(self, relay: Relay, states_hz: float | None = None) -> None:
        self._relay = relay
        self._thinning = None if states_hz is None else PeriodLimit(1.0 / states_hz)
        self._number = self._states = 0
        self._ended = False
        self.sent = dict.fromkeys(relay.sent, 0)
        """Totals of this listener, as in `Relay.sent`."""
        self.lag = Lag()
        self._own: deque[bytes] = deque(maxlen=_OWN_MESSAGES)
        self._send: Callable[[bytes], Sending] | None = None
        self._rest: SuspendedSend | None = None
        self._wanted = asyncio.Event()

    def restart(self) -> None:
        """Send the whole model next, and then the end of the session if it is over."""
        self._number = 0
        self._ended = False
        self.send_newest()

    def record_answer(self, state: ListenerState, now_ns: int) -> None:
        """Take the listener's answer, which came at this time of the monotonic clock."""
        self.lag.record_answer(state, self._relay.made_ns(state.time_s), now_ns)

    def figures(self, now_ns: int) -> dict[str, Any]:
        """Return the totals and the lag of the listener for a table."""
        return {**self.lag.figures(now_ns), **self.sent}

    def queue_message(self, message: bytes) -> None:
        """Queue a message for this listener alone; if the queue is full, the oldest is dropped."""
        self._own.append(message)
        self.send_newest()

    def next(self) -> bytes | None:
        """Return the next message, or None if the listener has all."""
        relay = self._relay
        if self._own:
            return self._own.popleft()
        if relay.number != self._number:
            follows = self._number == relay.number - 1 and relay.change is not None
            if self._number:
                self._count("skipped", relay.number - self._number - 1)
            self._number = relay.number
            if follows:
                return self._counted("changes", relay.change)
            return self._counted("wholes", relay.whole_model)
        if relay.states != self._states:
            skipped, self._states = relay.states - self._states - 1, relay.states
            first, thinning = self.sent["states"] < FIRST_ANSWERS, self._thinning
            if first or thinning is None or thinning.passes(time.monotonic()):
                self._count("skipped", skipped)
                return self._counted("states", relay.state)
        if relay.end is not None and not self._ended:
            self._ended = True
            return relay.end
        return None

    def _counted(self, kind: str, message: bytes | None) -> bytes | None:
        """Count one message given to the listener, and return it."""
        self._count(kind, 1)
        self._count(_BYTES_OF[kind], len(message or b""))
        return message

    def _count(self, kind: str, more: int) -> None:
        if more:
            self.sent[kind] += more
            self._relay.sent[kind] += more

    def send_newest(self) -> None:
        """While `serve` runs, send the newest messages until a send has to wait."""
        while self._send is not None and self._rest is None:
            message = self.next()
            if message is None:
                return
            self._rest = begin_send(self._send(message))
            if self._rest is not None or self._ended:
                self._wanted.set()

    async def serve(self, send: Callable[[bytes], Sending]) -> None:
        """Send the newest messages until the session is over.

        Raises
        ------
        ConnectionError
            The listener has disconnected.
        TimeoutError
            The listener has taken no message for `STALLED_S`.
        """
        self._states = max(0, self._relay.states - 1)  # it begins with the newest
        self._send = send
        try:
            self.send_newest()
            while self._rest is not None or not self._ended:
                await self._wanted.wait()
                self._wanted.clear()
                if self._rest is not None:
                    async with asyncio.timeout(STALLED_S):
                        await self._rest
                    self._rest = None
                    self.send_newest()
        finally:
            rest, self._rest, self._send = self._rest, None, None
            if rest is not None:
                rest.close()


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
