"""Read sensors between the ticks, on the loop that ticks.

The readings of a sensor with the ticks' rate arrive at nearly the same phase between two ticks for
seconds. Read at the ticks alone, their arrival would be known only to a whole period. And a frame
whose reading just missed its tick need not wait for the next one.
"""

import time
from collections.abc import Callable
from typing import Final

from mmt.core.running.ticking import LoopTimer

POLLS_HZ: Final = 100

_STEP: Final = 0.6180339887498949
"""Golden ratio: the phases lie evenly between the ticks, however many there were."""

RETRY_NS: Final = 120_000
"""Time from a tick or a further look that lacked a reading to the next look."""
_RETRIES_A_TICK: Final = 0.1
"""Mean number: if readings are always late, looking for them often does not help."""
_RETRIES_AT_ONCE: Final = 2000.0
"""Looks that can be saved up: a sensor nearly in step with the ticks is late at each tick for a
second or two, then at none for many seconds."""


class PhasePoller(LoopTimer):
    """Call back a hundred times a second, each time at another phase of the ticks.

    Parameters
    ----------
    callback
        Called with the monotonic time (ns).
    period_ns
        Period of the ticks.
    """

    def __init__(self, callback: Callable[[int], None], period_ns: int) -> None:
        super().__init__(callback)
        self._period_ns = period_ns
        self._phase = 0.0

    def start(self) -> None:
        """Start on the running loop."""
        super().start()
        self._wait(time.monotonic_ns())

    def _wait(self, now_ns: int) -> None:
        self._phase = (self._phase + _STEP) % 1.0
        interval_ns = 1_000_000_000 // POLLS_HZ
        slot_ns = (now_ns // interval_ns + 1) * interval_ns
        self.set(slot_ns + round(self._phase * self._period_ns))

    def _expire(self, now_ns: int) -> None:
        super()._expire(now_ns)
        self._wait(now_ns)


class Retry(LoopTimer):
    """Call back shortly after a tick that lacked a reading, a bounded number of times.

    Parameters
    ----------
    callback
        Called with the monotonic time (ns); returns whether a reading is still lacking.
    """

    def __init__(self, callback: Callable[[int], bool]) -> None:
        super().__init__(callback)
        self._credit = 0.0

    def tick(self, *, lacking: bool) -> None:
        """Note a tick, and whether it lacked a reading."""
        self._credit = min(self._credit + _RETRIES_A_TICK, _RETRIES_AT_ONCE)
        if lacking:
            self._again(time.monotonic_ns())

    def _again(self, now_ns: int) -> None:
        if self._credit >= 1.0:
            self._credit -= 1.0
            self.set(now_ns + RETRY_NS)

    def _expire(self, now_ns: int) -> None:
        if self._callback(now_ns):
            self._again(time.monotonic_ns())
