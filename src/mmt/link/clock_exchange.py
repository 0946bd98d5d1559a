"""Exchange time stamps with the other side, to estimate the offset of its clock.

The follower sends requests, the leader responds; the next request tells the leader when the
response arrived, so that both know all four time stamps. Layouts are in ``docs/reference/wire.md``.
Requests are queued and sent like frames, so that the offset holds for frames.
"""

import asyncio
import struct
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from mmt.core.running.process import clock_id
from mmt.link.clock_offset import ClockEstimate, ClockJump, ClockOffset
from mmt.link.incoming import BlockReader
from mmt.link.protocol import CLOCK, argument_of, encode_event
from mmt.link.queue import SendQueue

_REQUEST: Final = struct.Struct("<IqIq")
_RESPONSE: Final = struct.Struct("<Iqqq")
_LATEST_NS: Final = 2**61
"""Largest time stamp: seventy years; sums and differences of such stamps fit into 64 bits."""
_MAX_PENDING: Final = 512
"""Most pending exchanges: those of five seconds at the highest rate."""
_MAX_REQUESTS_HZ: Final = 400
"""Requests answered in a second: four times what our follower sends."""


class RemoteClock:
    """The other side's clock, estimated from the exchanges of time stamps.

    Parameters
    ----------
    reader
        Reader of the frames or commands, whose latencies need the offset.
    outbox
        Queues the messages.
    on_jump
        Called when one of the clocks has jumped.
    """

    def __init__(
        self, reader: BlockReader, outbox: SendQueue, on_jump: Callable[[ClockJump], None]
    ) -> None:
        self._reader = reader
        self._outbox = outbox
        self._on_jump = on_jump
        self._offset = ClockOffset()
        self._other: object = None
        self._begun_ns: int | None = None
        self._pending: OrderedDict[int, tuple[int, ...]] = OrderedDict()

    @property
    def is_shared(self) -> bool:
        """Whether both sides read the same clock."""
        return self._other == clock_id()

    @property
    def estimate(self) -> ClockEstimate | None:
        """The estimate from the exchanges, even if both sides read the same clock."""
        return self._offset.estimate

    @property
    def offset_ns(self) -> int | None:
        """The remote clock minus the local one now (ns), or None while it is unknown."""
        if self.is_shared:
            return 0
        estimate = self._offset.estimate
        return None if estimate is None else estimate.at(time.monotonic_ns())

    @property
    def unknown_s(self) -> float:
        """How long (s) the offset has been unknown on this connection, 0 if it is known."""
        if self._begun_ns is None or self.offset_ns is not None:
            return 0.0
        return (time.monotonic_ns() - self._begun_ns) / 1e9

    @property
    def statistics(self) -> dict[str, float | None]:
        """Offset, drift and uncertainty, None without an estimate; and the counts."""
        counts = {"jumps": self._offset.jumps, "exchanges": self._offset.exchanges}
        estimate = self._offset.estimate
        if estimate is None:
            return {"offset_ms": None, "drift_ppm": None, "uncertainty_ms": None, **counts}
        return {
            "offset_ms": estimate.offset_ns / 1e6,
            "drift_ppm": round(estimate.drift * 1e6, 3),
            "uncertainty_ms": estimate.uncertainty_ns / 1e6,
            **counts,
        }

    def start_connection(self, other: object) -> None:
        """Start a connection with the side whose clock has this id."""
        if other != self._other:
            self._offset.reset()
        self._other, self._begun_ns = other, time.monotonic_ns()
        self._pending.clear()
        self._reader.use_clock_offset(self.offset_ns)

    def _add_pending(self, number: int, stamps: tuple[int, ...]) -> None:
        self._pending[number] = stamps
        if len(self._pending) > _MAX_PENDING:
            self._pending.popitem(last=False)

    def add(self, time_ns: int, least_ns: int, most_ns: int) -> None:
        """Use an exchange: its time of completion, and the bounds of the offset (ns)."""
        jump = self._offset.add(time_ns, least_ns, most_ns)
        if not self.is_shared:
            self._reader.use_clock_offset(self.offset_ns)
        if jump is not None:
            self._on_jump(jump)


class ClockRequester(RemoteClock):
    """The follower's side of the exchange."""

    _number = 0
    _answered = (0, 0)
    _timer: asyncio.TimerHandle | None = None

    def start(self, rate_hz: float) -> None:
        """Send requests at this rate, 0 for none, until `stop`."""
        self.stop()
        if rate_hz > 0:
            self._send_request(asyncio.get_running_loop(), 1.0 / rate_hz)

    def stop(self) -> None:
        """Send no more requests."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def handle_response(self, *arguments: object) -> None:
        """Handle a response; its payload is not trusted."""
        arrival_ns = time.monotonic_ns()
        data = argument_of(arguments)
        if not isinstance(data, bytes) or len(data) != _RESPONSE.size:
            self._reader.reject("malformed clock")
            return
        number, asked_ns, there_ns, back_ns = _RESPONSE.unpack(data)
        if self._pending.pop(number, None) != (asked_ns,):
            return  # from an earlier connection, or repeated
        if not 0 <= there_ns <= back_ns < _LATEST_NS:
            self._reader.reject("malformed clock")
            return
        self._answered = (number, arrival_ns)
        self.add(arrival_ns, back_ns - arrival_ns, there_ns - asked_ns)

    def _send_request(self, loop: asyncio.AbstractEventLoop, period_s: float) -> None:
        self._timer = loop.call_later(period_s, self._send_request, loop, period_s)
        self._number = (self._number + 1) % 2**32
        now_ns = time.monotonic_ns()
        self._add_pending(self._number, (now_ns,))
        request = _REQUEST.pack(self._number, now_ns, *self._answered)
        self._outbox.put(0, encode_event(CLOCK, request))


class ClockResponder(RemoteClock):
    """The leader's side of the exchange."""

    _second = 0
    _in_second = 0

    def handle_request(self, *arguments: object) -> None:
        """Answer an untrusted request, and use the earlier exchange that it completes."""
        arrival_ns = time.monotonic_ns()
        data = argument_of(arguments)
        if not isinstance(data, bytes) or len(data) != _REQUEST.size:
            self._reader.reject("malformed clock")
            return
        if self._too_many(arrival_ns):
            self._reader.reject("too many clock")
            return
        number, asked_ns, answered, answer_arrival_ns = _REQUEST.unpack(data)
        if not (0 <= asked_ns < _LATEST_NS and 0 <= answer_arrival_ns < _LATEST_NS):
            self._reader.reject("malformed clock")
            return
        stamps = self._pending.pop(answered, None)
        if stamps is not None:
            before_ns, there_ns, back_ns = stamps
            self.add(back_ns, before_ns - there_ns, answer_arrival_ns - back_ns)
        if number in self._pending:
            return  # repeated
        now_ns = time.monotonic_ns()
        self._add_pending(number, (asked_ns, arrival_ns, now_ns))
        response = _RESPONSE.pack(number, asked_ns, arrival_ns, now_ns)
        self._outbox.put(0, encode_event(CLOCK, response))

    def _too_many(self, arrival_ns: int) -> bool:
        second = arrival_ns // 1_000_000_000
        if second != self._second:
            self._second, self._in_second = second, 0
        self._in_second += 1
        return self._in_second > _MAX_REQUESTS_HZ
