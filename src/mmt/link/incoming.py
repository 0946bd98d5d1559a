"""What arrives from a peer: bounded in rate, checked, counted and timed."""

import logging
import math
import struct
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import MmtError
from mmt.core.frames import LARGEST_QUANTITY
from mmt.core.output.logs import RepeatLimit
from mmt.core.running.ticking import TimeHistogram
from mmt.core.sequence_numbers import SEQUENCES, JumpBound, shortest_period_ns, steps_ahead
from mmt.link.protocol import MAX_RECORDS_PER_MESSAGE, argument_of

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


LOG: Final = logging.getLogger("mmt.link")

_CODES: Final = {"<u4": "I", "<i8": "q", "<f4": "f", "<f8": "d"}
_WINDOW: Final = 256
"""Newest sequence numbers among which repeated records are distinguished from late ones."""
_MASK: Final = (1 << _WINDOW) - 1
LATEST_NS: Final = 2**62
"""Largest time of a sender's clock: 146 years; sums of such times still fit into 64 bits."""


class BlockReader:
    """Turn a message's bytes into a validated block of records.

    Malformed messages, and records that are not finite, out of range, repeated or out of order
    are dropped and counted. A jump in ``sequence`` counts as lost records, if it is plausible for
    the time that has passed. Numbers may wrap. A message that begins far behind the newest number
    but at a later time comes from a sender with new numbers: a late record has an earlier time.
    About 2 us a message and 1.5 us a record.

    Parameters
    ----------
    dtype
        Packed little-endian dtype whose first fields are ``sequence`` (u4) and ``time_ns``
        (i8), all others numbers.
    kind
        Name of the records in the log.
    shortest_ns
        Shortest mean time between two records; see `mmt.core.sequence_numbers`.
    """

    def __init__(
        self,
        dtype: np.dtype[np.void],
        kind: str,
        shortest_ns: int = shortest_period_ns(1000, 100),
    ) -> None:
        self._dtype = dtype
        self._layout = _layout(dtype)
        self._kind = kind
        self._limit = RepeatLimit()
        self._bound = JumpBound(shortest_ns)
        integers = sum(code in "Iq" for code in self._layout.format)
        self._quantities = slice(integers, None)
        self._started = False
        self._fresh = True
        self._newest, self._newest_ns = -1, 0
        self._seen = 0
        self._offset_ns: int | None = None
        self.latency = TimeHistogram()
        """One-way latencies of the records that came while the clock offset was known."""
        self.messages = self.bytes = self.records = 0
        self.lost = self.repeated = self.out_of_order = 0
        self.rejected: dict[str, int] = {}
        self.on_rejected: Callable[[str, int], None] | None = None
        """Called at most once a second for each reason, with the number since the last call."""

    def restart(self) -> None:
        """Prepare for a new connection, of the same sender or of another one.

        The same sender continues its numbers; a sequence number at or below those seen, or too
        far ahead, then means a new sender.
        """
        self._fresh = True
        self._offset_ns = None

    def use_clock_offset(self, offset_ns: int | None) -> None:
        """Set the sender's clock minus the local one (ns); None while it is unknown."""
        self._offset_ns = offset_ns

    def read(self, arguments: tuple[object, ...], arrival_ns: int) -> RecordArray | None:
        """Return the valid records of an event, shape (n,), read-only, or None.

        Parameters
        ----------
        arguments
            The event's arguments, which are not trusted.
        arrival_ns
            Monotonic time of the arrival.
        """
        data = argument_of(arguments)
        if not isinstance(data, bytes):
            self.reject("not bytes")
            return None
        count, rest = divmod(len(data), self._dtype.itemsize)
        if rest or not count:
            self.reject("size")
            return None
        if count > MAX_RECORDS_PER_MESSAGE:
            self.reject("too many")
            return None
        self.messages += 1
        self.bytes += len(data)
        block: RecordArray = np.frombuffer(data, dtype=self._dtype)
        if count == 1:  # the usual case, without lists
            accepted = self._accept(self._layout.unpack(data), arrival_ns, first=True)
            self.records += accepted
            return block if accepted else None
        records = enumerate(self._layout.iter_unpack(data))
        good = [self._accept(record, arrival_ns, first=at == 0) for at, record in records]
        self.records += sum(good)
        if all(good):
            return block
        return block[np.array(good)] if any(good) else None

    def reject(self, reason: str) -> None:
        """Count a rejected message or record, and log it at a bounded rate."""
        self.rejected[reason] = self.rejected.get(reason, 0) + 1
        times = self._limit.allow(reason)
        if times:
            LOG.warning("%s rejected: %s (%d times)", self._kind, reason, times)
            if self.on_rejected is not None:
                self.on_rejected(reason, times)

    def is_plausible(self, sent: int, arrival_ns: int) -> bool:
        """Return whether the sender can have sent this many records; see `end`."""
        lost = steps_ahead(sent, self._newest) - 1
        return lost <= 0 or self._bound.permits(lost, arrival_ns)

    def end(self, sent: int, arrival_ns: int) -> None:
        """Count as lost the records that the sender sent after the last one received.

        Parameters
        ----------
        sent
            Sequence number after that of the last record sent.
        arrival_ns
            Monotonic time of the arrival.
        """
        lost = steps_ahead(sent, self._newest) - 1
        if not 0 <= sent <= SEQUENCES or (lost > 0 and not self._bound.allows(lost, arrival_ns)):
            self.reject("implausible count")
        else:
            self.lost += max(0, lost)

    def _accept(self, record: tuple[Any, ...], arrival_ns: int, *, first: bool) -> bool:
        if not self._in_order(record[0], record[1], arrival_ns, first=first):
            return False
        size = math.hypot(*record[self._quantities])  # one call finds every bad value
        if not size <= LARGEST_QUANTITY:
            self.reject("out of range" if math.isfinite(size) else "not finite")
            return False
        if not 0 <= record[1] < LATEST_NS:
            self.reject("time out of range")
            return False
        if self._offset_ns is not None:
            self.latency.add(arrival_ns + self._offset_ns - record[1])
        return True

    def _in_order(self, sequence: int, time_ns: int, arrival_ns: int, *, first: bool) -> bool:
        ahead = steps_ahead(sequence, self._newest)
        if self._fresh:
            if self._started and ahead > 0 and self._bound.allows(ahead, arrival_ns):
                self.lost += ahead - 1
            self._started, self._fresh = True, False
            self._newest, self._newest_ns, self._seen = sequence, time_ns, 1
            self._bound.restart(arrival_ns)
            return True
        if first and ahead <= -_WINDOW and time_ns > self._newest_ns:
            if not self._bound.allows(1, arrival_ns):
                self.reject("implausible restart")
                return False
            self._newest, self._newest_ns, self._seen = sequence, time_ns, 1
            return True
        if ahead > 0:
            if not self._bound.allows(ahead, arrival_ns):
                self.reject("implausible jump")
                return False
            self.lost += ahead - 1
            self._newest, self._newest_ns = sequence, time_ns
            self._seen = (self._seen << ahead | 1) & _MASK if ahead < _WINDOW else 1
            return True
        if self._seen >> -ahead & 1:
            self.repeated += 1
        else:
            self.out_of_order += 1
            if -ahead < _WINDOW:
                self._seen |= 1 << -ahead
        return False


def _layout(dtype: np.dtype[np.void]) -> struct.Struct:
    """Return the struct layout of a packed record dtype."""
    codes = []
    for name in dtype.names or ():
        field = dtype[name]
        codes.append(f"{math.prod(field.shape)}{_CODES[field.base.str]}")
    return struct.Struct("<" + "".join(codes))
