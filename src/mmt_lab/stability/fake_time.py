"""An event loop on a clock that jumps to the next timer instead of waiting."""

import asyncio
import selectors
from collections.abc import Callable
from typing import Any


class FakeClock:
    """A monotonic clock that moves only while the loop waits.

    Parameters
    ----------
    late_ns
        Called at each wait; returns by how much the loop wakes late.
    """

    def __init__(self, late_ns: Callable[[], int]) -> None:
        self._late_ns = late_ns
        self._now_ns = 10**9

    def now_ns(self) -> int:
        """Return the time in ns."""
        return self._now_ns

    def pass_by(self, seconds: float) -> None:
        """Let a time pass, and what the waking is late."""
        self._now_ns += round(1e9 * seconds) + self._late_ns()


class _FakeSelector(selectors.SelectSelector):
    """Wait for nothing but the clock."""

    def __init__(self, clock: FakeClock) -> None:
        super().__init__()
        self._clock = clock

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if not ready and timeout:
            self._clock.pass_by(timeout)
        return ready


class FakeTimeLoop(asyncio.SelectorEventLoop):
    """An asyncio loop on a fake clock."""

    def __init__(self, clock: FakeClock) -> None:
        super().__init__(_FakeSelector(clock))
        self._fake = clock

    def time(self) -> float:
        """Return the clock's time in seconds."""
        return self._fake.now_ns() / 1e9


def run_in_fake_time(clock: FakeClock, work: Callable[[], Any]) -> None:
    """Run a coroutine function on a loop of this clock to its end."""
    loop = FakeTimeLoop(clock)
    try:
        loop.run_until_complete(work())
    finally:
        loop.close()
