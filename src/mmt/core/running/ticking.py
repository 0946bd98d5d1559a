"""Precise timers on the asyncio loop, and a tick: no drift, no tick lost, cheap statistics."""

import asyncio
import ctypes
import os
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

LATE_NS: Final = 1_000_000
"""A tick handed over later than this counts as late."""

_SUB_BITS: Final = 7
_LARGEST_NS: Final = 2**40 - 1


class TimeHistogram:
    """Bounded counts of durations, for quantiles over a whole run.

    The bins grow with the duration, 128 per power of two, so that a quantile is accurate to
    0.8 % from 1 ns to 18 minutes. Longer durations count as 18 minutes. `add` takes a fraction
    of a microsecond. Only bins with counts are kept: a few kB, at most 400 kB.
    """

    def __init__(self) -> None:
        self.count = 0
        self._bins: defaultdict[int, int] = defaultdict(int)

    def add(self, duration_ns: int) -> None:
        """Count one duration; a negative one counts as zero."""
        if not 0 <= duration_ns <= _LARGEST_NS:
            duration_ns = min(max(duration_ns, 0), _LARGEST_NS)
        octave = duration_ns.bit_length() - _SUB_BITS - 1
        octave = octave if octave > 0 else 0
        self._bins[(octave << _SUB_BITS) + (duration_ns >> octave)] += 1
        self.count += 1

    def quantile_ns(self, fraction: float) -> float | None:
        """Return the duration below which this fraction of the counted ones lies.

        Interpolates inside the bin. None before the first `add`.

        Raises
        ------
        ValueError
            `fraction` is not within 0 to 1.
        """
        if not 0.0 <= fraction <= 1.0:
            message = f"fraction is {fraction}: allowed is 0 to 1"
            raise ValueError(message)
        wanted = fraction * self.count
        below = 0
        for index, count in sorted(self._bins.items()):
            if below + count >= wanted:
                octave = max((index >> _SUB_BITS) - 1, 0)
                lowest = (index - (octave << _SUB_BITS)) << octave
                return lowest + (wanted - below) / count * ((1 << octave) - 1)
            below += count
        return None

    def cumulative(self, bounds_ns: list[int]) -> tuple[list[int], float]:
        """Return how many durations lie below each bound, and the sum of all in ns.

        Both are accurate to the width of a bin; the bounds must increase.
        """
        counts, total, sum_ns = [0] * len(bounds_ns), 0, 0.0
        place = 0
        for index, count in sorted(self._bins.items()):
            octave = max((index >> _SUB_BITS) - 1, 0)
            middle = ((index - (octave << _SUB_BITS)) << octave) + ((1 << octave) - 1) / 2
            while place < len(bounds_ns) and middle > bounds_ns[place]:
                counts[place] = total
                place += 1
            total += count
            sum_ns += count * middle
        counts[place:] = [total] * (len(bounds_ns) - place)
        return counts, sum_ns

    def quantile_ms(self, fraction: float) -> float | None:
        """Return the quantile in milliseconds; see `quantile_ns`."""
        quantile_ns = self.quantile_ns(fraction)
        return None if quantile_ns is None else quantile_ns / 1e6


@dataclass(frozen=True)
class TickStatistics:
    """How punctual a ticker was; periods and late share are None if not measured."""

    ticks: int
    """Ticks that fell due and were handed over, missed ones included."""
    missed: int
    """Ticks without a callback of their own, handed over with a later one."""
    period_p50_ms: float | None
    period_p99_ms: float | None
    late_share_1ms: float | None
    """Share of the ticks that were handed over more than 1 ms after they fell due."""


class TimerFile:
    """A kernel timer (timerfd) on the monotonic clock, which wakes a loop and is read unblocked.

    asyncio rounds its own timers up to 1 ms.
    """

    def __init__(self) -> None:
        if sys.version_info >= (3, 13):
            self.file = os.timerfd_create(
                time.CLOCK_MONOTONIC, flags=os.TFD_NONBLOCK | os.TFD_CLOEXEC
            )
        else:
            self._libc = ctypes.CDLL(None, use_errno=True)
            self.file = self._libc.timerfd_create(
                time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC
            )
            if self.file < 0:
                code = ctypes.get_errno()
                raise OSError(code, os.strerror(code))

    def arm(self, first_ns: int, period_ns: int) -> None:
        """Expire at the absolute monotonic time `first_ns`, then every period (0: once)."""
        if sys.version_info >= (3, 13):
            os.timerfd_settime_ns(
                self.file, flags=os.TFD_TIMER_ABSTIME, initial=first_ns, interval=period_ns
            )
        else:
            absolute = 1
            times = (*divmod(period_ns, 10**9), *divmod(first_ns, 10**9))
            specification = (ctypes.c_long * 4)(*times)
            if self._libc.timerfd_settime(self.file, absolute, specification, None):
                code = ctypes.get_errno()
                raise OSError(code, os.strerror(code))

    def expirations(self) -> int:
        """Return how often the timer has expired since the last call."""
        try:
            return int.from_bytes(os.read(self.file, 8), sys.byteorder)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Release the timer."""
        os.close(self.file)


def open_timer() -> TimerFile | None:
    """Return a timerfd, or None if the system has none."""
    if sys.platform != "linux":
        return None
    try:
        return TimerFile()
    except (OSError, AttributeError):
        return None


class LoopTimer:
    """A timer of the running loop that is more precise than the loop's own.

    Parameters
    ----------
    callback
        Called with the monotonic time (ns), once for each `set`, or once for each period.
    coarse
        Whether to use the loop's own timer if the system has no precise ones; else the callback
        is never called there.
    """

    def __init__(self, callback: Callable[[int], object], *, coarse: bool = False) -> None:
        self._callback = callback
        self._coarse = coarse
        self._timer: TimerFile | None = None
        self._handle: asyncio.TimerHandle | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._due_ns = 0

    def start(self) -> None:
        """Start on the running loop, unless started; without a loop the timer never expires."""
        if self._loop is not None:
            return
        try:
            self._loop = asyncio.get_running_loop()
        except RuntimeError:
            return
        self._timer = open_timer()
        if self._timer is not None:
            self._loop.add_reader(self._timer.file, self._on_readable, self._timer)

    def stop(self) -> None:
        """End; calling it twice is harmless."""
        if self._timer is not None and self._loop is not None:
            self._loop.remove_reader(self._timer.file)
            self._timer.close()
        if self._handle is not None:
            self._handle.cancel()
        self._timer = self._handle = self._loop = None
        self._due_ns = 0

    def set(self, at_ns: int, period_ns: int = 0) -> None:
        """Call back at a monotonic time (ns) in place of the one set before; 0 is never.

        A precise timer then calls back every period, unless that is 0.
        """
        if at_ns == self._due_ns:
            return
        self._due_ns = at_ns
        if self._timer is not None:
            self._timer.arm(at_ns, period_ns)
        elif self._coarse and self._loop is not None:
            if self._handle is not None:
                self._handle.cancel()
                self._handle = None
            if at_ns:
                wait_s = (at_ns - time.monotonic_ns()) / 1e9
                self._handle = self._loop.call_at(self._loop.time() + wait_s, self._expire_now)

    def _on_readable(self, timer: TimerFile) -> None:
        if timer.expirations():
            self._expire_now()

    def _expire_now(self) -> None:
        self._due_ns = 0
        self._expire(time.monotonic_ns())

    def _expire(self, now_ns: int) -> None:
        self._callback(now_ns)


class Ticker(LoopTimer):
    """Call back on the running loop at a fixed rate.

    On Linux a timerfd wakes the loop and keeps the period to some 50 us. Elsewhere the loop
    wakes by `loop.call_at` with absolute deadlines, which asyncio rounds up to its clock's
    resolution. Neither drifts. After the loop was blocked, one callback gets the number of
    ticks that have fallen due since the last one, so that no tick is lost.

    Parameters
    ----------
    period_ns
        Time from tick to tick; the first falls due one period after `start`.
    callback
        Called with the ticks elapsed since its last call, at least 1. An exception in it stops
        the ticker, and `wait` raises it.
    statistics
        Whether to measure periods and lateness, about 1 us a tick.

    Raises
    ------
    ValueError
        `period_ns` is not positive.
    """

    def __init__(
        self, period_ns: int, callback: Callable[[int], None], *, statistics: bool = True
    ) -> None:
        if period_ns <= 0:
            message = f"period_ns is {period_ns}: it must be positive"
            raise ValueError(message)
        super().__init__(callback, coarse=True)
        self._period_ns = period_ns
        self._measures = statistics
        self.periods = TimeHistogram()
        """The times from tick to tick."""
        self._ticks = 0
        self._missed = 0
        self._late = 0
        self._last_ns = 0
        self._next_ns = 0
        self._done: asyncio.Future[None] | None = None

    @property
    def running(self) -> bool:
        """Whether the ticker is started and has not stopped."""
        return self._done is not None and not self._done.done()

    @property
    def lateness(self) -> tuple[int, int]:
        """Number of ticks so far, and number of those that were over 1 ms late."""
        return self._ticks, self._late

    @property
    def statistics(self) -> TickStatistics:
        """Measurements so far; computing them takes a few hundred microseconds."""
        measured = self._measures and self._ticks > 0
        return TickStatistics(
            ticks=self._ticks,
            missed=self._missed,
            period_p50_ms=self.periods.quantile_ms(0.5),
            period_p99_ms=self.periods.quantile_ms(0.99),
            late_share_1ms=self._late / self._ticks if measured else None,
        )

    def start(self) -> None:
        """Start to tick on the running loop.

        Raises
        ------
        RuntimeError
            No loop is running, or the ticker was started before.
        """
        if self._done is not None:
            message = "a ticker starts once: make a new one"
            raise RuntimeError(message)
        self._done = asyncio.get_running_loop().create_future()
        self._next_ns = time.monotonic_ns() + self._period_ns
        super().start()
        self.set(self._next_ns, self._period_ns)

    def stop(self) -> None:
        """Stop the ticker, if it is running."""
        self._finish(None)

    async def wait(self) -> None:
        """Wait until the ticker has stopped; raise the exception of its callback, if any.

        Raises
        ------
        RuntimeError
            The ticker was not started.
        """
        if self._done is None:
            message = "the ticker was not started"
            raise RuntimeError(message)
        await asyncio.wait([self._done])
        self._done.result()

    def _finish(self, error: Exception | None) -> None:
        if self._done is None or self._done.done():
            return
        super().stop()
        if error is None:
            self._done.set_result(None)
        elif isinstance(error, StopIteration):  # which a future cannot carry
            wrapped = RuntimeError("the tick's callback raised StopIteration")
            wrapped.__cause__ = error
            self._done.set_exception(wrapped)
        else:
            self._done.set_exception(error)

    def _on_readable(self, timer: TimerFile) -> None:
        if elapsed := timer.expirations():
            self._tick(elapsed)

    def _expire(self, now_ns: int) -> None:
        elapsed = (now_ns - self._next_ns) // self._period_ns + 1
        if elapsed > 0:  # the loop may wake us early by its clock's resolution
            self._tick(elapsed)
        if self.running:
            self.set(self._next_ns)

    def _tick(self, elapsed: int) -> None:
        if self._measures:
            self._measure(elapsed)
        self._ticks += elapsed
        self._missed += elapsed - 1
        self._next_ns += elapsed * self._period_ns
        try:
            self._callback(elapsed)
        except Exception as error:  # noqa: BLE001 - passed on to the waiting task
            self._finish(error)

    def _measure(self, elapsed: int) -> None:
        now_ns = time.monotonic_ns()
        if self._last_ns:
            self.periods.add(now_ns - self._last_ns)
        self._last_ns = now_ns
        late_ns = now_ns - self._next_ns - LATE_NS
        if late_ns > 0:
            self._late += min(late_ns // self._period_ns + 1, elapsed)
