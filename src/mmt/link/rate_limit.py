"""Bound the rate at which a peer may send, by a token bucket, and the rate of repeated actions."""

from collections.abc import Callable
from typing import Final

from mmt.core.errors import MmtError

MESSAGES_PER_PERIOD: Final = 10
"""Messages that a peer may send for each record that the session expects at its rate."""
BYTES_PER_PERIOD: Final = 20_000
"""The same for bytes: more than a replay of the largest frames at 100 times real time sends."""
BURST_S: Final = 10.0
"""Size of the token bucket, in time: after a stall a network may deliver this burst at once."""
GRACE_S: Final = 2.0
"""A peer that exceeds the limit for longer than this is cut off."""
HANDSHAKE_MESSAGES: Final = 4
"""Messages, and pings, that a connection may send before it is admitted; it needs one."""


class RateLimit:
    """Limit the rate of messages and bytes; a few integer operations a message.

    A token bucket in units of time: each message costs some time, and the clock refills the bucket.
    If the clock jumps back, the bucket moves with it. Messages that find it empty are dropped.

    Parameters
    ----------
    rate_hz
        Records a second that the session expects of the peer.
    on_drop
        Called with the reason for each message that is dropped.
    on_exceeded
        Called once, with an error, when the peer keeps exceeding the limit and is cut off.
    """

    def __init__(
        self,
        rate_hz: float,
        on_drop: Callable[[str], None],
        on_exceeded: Callable[[MmtError], None],
    ) -> None:
        self._message_ns = max(1, round(1e9 / (rate_hz * MESSAGES_PER_PERIOD)))
        self._byte_ps = max(1, round(1e12 / (rate_hz * BYTES_PER_PERIOD)))
        self._burst_ns = round(BURST_S * 1e9)
        self._now_ns = self._due_ns = 0
        self._over_since_ns: int | None = None
        self.drop = on_drop
        self._on_rate_exceeded = on_exceeded
        self._messages_hz = round(rate_hz * MESSAGES_PER_PERIOD)
        self.shut = False
        """Whether the peer exceeded the limit for too long and is to be cut off."""

    def open(self) -> None:
        """Lift the cut-off for a new connection; the bucket keeps its level."""
        self.shut = False
        self._over_since_ns = None

    def passes(self, size: int, now_ns: int) -> bool:
        """Return whether a message of `size` bytes that arrives now may pass."""
        if now_ns < self._now_ns:
            self._due_ns -= self._now_ns - now_ns
            self._over_since_ns = None
        self._now_ns = now_ns
        due_ns = max(self._due_ns, now_ns) + self._message_ns + size * self._byte_ps // 1000
        if due_ns - now_ns <= self._burst_ns:
            self._due_ns = due_ns
            if self._over_since_ns is not None and due_ns - now_ns < self._burst_ns // 2:
                self._over_since_ns = None
            return True
        self.drop("too fast")
        if self._over_since_ns is None:
            self._over_since_ns = now_ns
        elif not self.shut and now_ns - self._over_since_ns > GRACE_S * 1e9:
            self.shut = True
            self._on_rate_exceeded(
                MmtError(
                    f"it sent more than {self._messages_hz} messages, or "
                    f"{self._messages_hz // MESSAGES_PER_PERIOD * BYTES_PER_PERIOD / 1e6:g} MB, a "
                    f"second for {GRACE_S:g} s"
                )
            )
        return False


class HandshakeLimit:
    """Limit the messages of a connection that is not admitted yet."""

    def __init__(self) -> None:
        self._left = HANDSHAKE_MESSAGES
        self.shut = False

    def passes(self, size: int, now_ns: int) -> bool:  # noqa: ARG002 - as in RateLimit
        """Return whether one more message may pass."""
        self._left -= 1
        self.shut = self._left < 0
        return not self.shut

    def drop(self, reason: str) -> None:
        """Ignore a message of a stranger."""


class PeriodLimit:
    """Permit an action once per period on average, however irregular the requests are.

    Parameters
    ----------
    period_s
        The period.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._due_s = 0.0

    def passes(self, now_s: float) -> bool:
        """Return whether the action is permitted now, which may be half a period early."""
        if now_s < self._due_s - 0.5 * self._period_s:
            return False
        self._due_s = max(self._due_s, now_s - 0.5 * self._period_s) + self._period_s
        return True
