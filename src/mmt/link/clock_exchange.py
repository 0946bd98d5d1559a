"""Exchange time stamps with the other side, and know its clock.

The follower asks, the leader answers; the next question tells the leader when the answer came,
so that both know all four stamps. Layouts are in ``docs/reference/wire.md``. The questions wait
and travel as frames do, so that the offset holds for these.
"""

import asyncio
import struct
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from mmt.core.process import clock_id
from mmt.link.clock_offset import ClockEstimate, ClockJump, ClockOffset
from mmt.link.protocol import CLOCK, argument_of, encode_event
from mmt.link.queue import SendQueue
from mmt.link.reader import BlockReader

_QUESTION: Final = struct.Struct("<IqIq")
_ANSWER: Final = struct.Struct("<Iqqq")
_LATEST_NS: Final = 2**61
"""Seventy years; what two such stamps make can still be added."""
_REMEMBERED: Final = 512
"""Exchanges that may be under way, five seconds' worth at the highest rate."""
_MOST_PER_S: Final = 400
"""Questions that are answered in a second: four times what a follower of ours asks."""


class RemoteClock:
    """The other side's clock, from the leader's or the follower's exchanges.

    Parameters
    ----------
    reader
        Of the frames or commands, whose latencies need the offset.
    outbox
        Takes the messages.
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
        self._under_way: OrderedDict[int, tuple[int, ...]] = OrderedDict()

    @property
    def same(self) -> bool:
        """Whether both sides read the same clock."""
        return self._other == clock_id()

    @property
    def estimate(self) -> ClockEstimate | None:
        """What the exchanges say, also of a clock that is the same."""
        return self._offset.estimate

    @property
    def offset_ns(self) -> int | None:
        """The other's clock minus this one's now, None while it is not known."""
        if self.same:
            return 0
        estimate = self._offset.estimate
        return None if estimate is None else estimate.at(time.monotonic_ns())

    @property
    def statistics(self) -> dict[str, float | None]:
        """Offset, drift and their like, None where nothing was exchanged."""
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

    def meet(self, other: object) -> None:
        """Begin a connection with the side whose clock has this name."""
        if other != self._other:
            self._offset.reset()
        self._other = other
        self._under_way.clear()
        self._reader.use_clock_offset(self.offset_ns)

    def _remember(self, number: int, stamps: tuple[int, ...]) -> None:
        self._under_way[number] = stamps
        if len(self._under_way) > _REMEMBERED:
            self._under_way.popitem(last=False)

    def _take(self, time_ns: int, least_ns: int, most_ns: int) -> None:
        jump = self._offset.add(time_ns, least_ns, most_ns)
        if not self.same:
            self._reader.use_clock_offset(self.offset_ns)
        if jump is not None:
            self._on_jump(jump)


class ClockRequester(RemoteClock):
    """The follower's side."""

    _number = 0
    _answered = (0, 0)
    _timer: asyncio.TimerHandle | None = None

    def start(self, rate_hz: float) -> None:
        """Ask at this rate, 0 for never, until `stop`."""
        self.stop()
        if rate_hz > 0:
            self._ask(asyncio.get_running_loop(), 1.0 / rate_hz)

    def stop(self) -> None:
        """Ask no more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def take_answer(self, *arguments: object) -> None:
        """Use an answer, as anybody may have sent it."""
        arrival_ns = time.monotonic_ns()
        data = argument_of(arguments)
        if not isinstance(data, bytes) or len(data) != _ANSWER.size:
            self._reader.reject("malformed clock")
            return
        number, asked_ns, there_ns, back_ns = _ANSWER.unpack(data)
        if self._under_way.pop(number, None) != (asked_ns,):
            return  # of an earlier connection, or a repeated one
        if not 0 <= there_ns <= back_ns < _LATEST_NS:
            self._reader.reject("malformed clock")
            return
        self._answered = (number, arrival_ns)
        self._take(arrival_ns, back_ns - arrival_ns, there_ns - asked_ns)

    def _ask(self, loop: asyncio.AbstractEventLoop, period_s: float) -> None:
        self._timer = loop.call_later(period_s, self._ask, loop, period_s)
        self._number = (self._number + 1) % 2**32
        now_ns = time.monotonic_ns()
        self._remember(self._number, (now_ns,))
        question = _QUESTION.pack(self._number, now_ns, *self._answered)
        self._outbox.put(0, encode_event(CLOCK, question))


class ClockResponder(RemoteClock):
    """The leader's side."""

    _second = 0
    _in_second = 0

    def take_question(self, *arguments: object) -> None:
        """Answer a question, as anybody may have sent it, and learn from the one before."""
        arrival_ns = time.monotonic_ns()
        data = argument_of(arguments)
        if not isinstance(data, bytes) or len(data) != _QUESTION.size:
            self._reader.reject("malformed clock")
            return
        if self._too_many(arrival_ns):
            self._reader.reject("too many clock")
            return
        number, asked_ns, answered, answer_arrival_ns = _QUESTION.unpack(data)
        if not (0 <= asked_ns < _LATEST_NS and 0 <= answer_arrival_ns < _LATEST_NS):
            self._reader.reject("malformed clock")
            return
        stamps = self._under_way.pop(answered, None)
        if stamps is not None:
            before_ns, there_ns, back_ns = stamps
            self._take(back_ns, before_ns - there_ns, answer_arrival_ns - back_ns)
        if number in self._under_way:
            return  # a repeated one
        now_ns = time.monotonic_ns()
        self._remember(number, (asked_ns, arrival_ns, now_ns))
        answer = _ANSWER.pack(number, asked_ns, arrival_ns, now_ns)
        self._outbox.put(0, encode_event(CLOCK, answer))

    def _too_many(self, arrival_ns: int) -> bool:
        second = arrival_ns // 1_000_000_000
        if second != self._second:
            self._second, self._in_second = second, 0
        self._in_second += 1
        return self._in_second > _MOST_PER_S
