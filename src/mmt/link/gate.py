"""Bound what a peer may send in messages and bytes, before anything is decoded."""

from collections.abc import Callable
from typing import Final

from mmt.core.errors import MmtError

MESSAGES_PER_PERIOD: Final = 10
"""Messages that a peer may send for each record that the session's rate expects of it."""
BYTES_PER_PERIOD: Final = 20_000
"""Likewise bytes: four times what a replay at a hundred times real time sends."""
BURST_S: Final = 10.0
"""A network that held messages back may deliver so much time's worth of the bound at once."""
PATIENCE_S: Final = 2.0
"""A peer that is over its bound for so long is cut off."""
STRANGERS_MESSAGES: Final = 50
"""Who has not been let in needs two or three."""


class Gate:
    """Let messages pass at a bounded rate; a few integer operations a message.

    A bucket of time: each message takes out what it costs, the clock fills it up. Messages
    that find it empty are thrown away and counted.

    Parameters
    ----------
    rate_hz
        Records a second that the session expects of the peer.
    on_excess
        Called for each message that is thrown away.
    on_shut
        Called with a fault once, when the peer goes on all the same and is cut off.
    """

    def __init__(
        self,
        rate_hz: float,
        on_excess: Callable[[], None],
        on_shut: Callable[[MmtError], None],
    ) -> None:
        self._message_ns = max(1, round(1e9 / (rate_hz * MESSAGES_PER_PERIOD)))
        self._byte_ps = max(1, round(1e12 / (rate_hz * BYTES_PER_PERIOD)))
        self._burst_ns = round(BURST_S * 1e9)
        self._due_ns = 0
        self._over_since_ns: int | None = None
        self._on_excess = on_excess
        self._on_shut = on_shut
        self._messages_hz = round(rate_hz * MESSAGES_PER_PERIOD)
        self.shut = False
        """Whether the peer was over its bound for too long, and is to be cut off."""

    def open(self) -> None:
        """Give a peer that connects anew another chance; what it owes stays."""
        self.shut = False
        self._over_since_ns = None

    def passes(self, size: int, now_ns: int) -> bool:
        """Whether a message of so many bytes that arrives now may pass."""
        due_ns = max(self._due_ns, now_ns) + self._message_ns + size * self._byte_ps // 1000
        if due_ns - now_ns <= self._burst_ns:
            self._due_ns = due_ns
            if self._over_since_ns is not None and due_ns - now_ns < self._burst_ns // 2:
                self._over_since_ns = None
            return True
        self._on_excess()
        if self._over_since_ns is None:
            self._over_since_ns = now_ns
        elif not self.shut and now_ns - self._over_since_ns > PATIENCE_S * 1e9:
            self.shut = True
            self._on_shut(
                MmtError(
                    f"it sent more than {self._messages_hz} messages, or "
                    f"{self._messages_hz // MESSAGES_PER_PERIOD * BYTES_PER_PERIOD / 1e6:g} MB, a "
                    f"second for {PATIENCE_S:g} s"
                )
            )
        return False


class StrangersGate:
    """Let the few messages pass that somebody needs who has not been let in yet."""

    def __init__(self) -> None:
        self._left = STRANGERS_MESSAGES
        self.shut = False

    def passes(self, size: int, now_ns: int) -> bool:  # noqa: ARG002 - as of a Gate
        """Whether one more may pass."""
        self._left -= 1
        self.shut = self._left < 0
        return not self.shut
