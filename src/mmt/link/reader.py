"""Check, count and time the blocks of records that arrive from the other side."""

import logging
import math
import struct
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.frames import SEQUENCES, steps_ahead
from mmt.core.logs import RepeatLimit
from mmt.core.sequence_numbers import JumpBound, shortest_period_ns
from mmt.core.ticking import TimeHistogram
from mmt.link.protocol import MAX_RECORDS_PER_MESSAGE, argument_of

LOG: Final = logging.getLogger("mmt.link")

_CODES: Final = {"<u4": "I", "<i8": "q", "<f4": "f", "<f8": "d"}
_WINDOW: Final = 256
"""Newest sequence numbers among which repeated records are distinguished from late ones."""
_MASK: Final = (1 << _WINDOW) - 1
LARGEST_QUANTITY: Final = 1e6
"""Largest norm of a record's quantities: a kilometre (mm), or the weight of a hundred tons (N);
more is a fault, not a measurement."""
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
