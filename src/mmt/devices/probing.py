"""Look at sensors between the ticks, so that the clocks can be told apart more closely.

A sensor whose rate is that of the ticks arrives at nearly the same point between two ticks for
seconds; read at the ticks alone, its readings would tell when they arrived to a whole period.
"""

import asyncio
import time
from collections.abc import Callable
from typing import Final

from mmt.timer_file import TimerFile, open_timer

PROBES_HZ: Final = 100

_STEP: Final = 0.6180339887498949
"""Golden ratio: the phases lie evenly between the ticks, however many there were."""


class Prober:
    """Call back a hundred times a second, each time at another phase of the ticks.

    Where the system has no precise timers, or no loop runs, there are no calls.

    Parameters
    ----------
    callback
        Called with the monotonic time (ns).
    period_ns
        Of the ticks.
    """

    def __init__(self, callback: Callable[[int], None], period_ns: int) -> None:
        self._callback = callback
        self._period_ns = period_ns
        self._phase = 0.0
        self._timer: TimerFile | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    def start(self) -> None:
        """Begin, on the running loop."""
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            return
        timer = open_timer()
        if timer is not None:
            self._loop, self._timer = loop, timer
            loop.add_reader(timer.file, self._on_readable, timer)
            self._arm(timer, time.monotonic_ns())

    def stop(self) -> None:
        """End; calling it twice is harmless."""
        if self._timer is not None and self._loop is not None:
            self._loop.remove_reader(self._timer.file)
            self._timer.close()
            self._timer = None

    def _arm(self, timer: TimerFile, now_ns: int) -> None:
        self._phase = (self._phase + _STEP) % 1.0
        interval_ns = 1_000_000_000 // PROBES_HZ
        slot_ns = (now_ns // interval_ns + 1) * interval_ns
        timer.arm(slot_ns + round(self._phase * self._period_ns), 0)

    def _on_readable(self, timer: TimerFile) -> None:
        if timer.expirations():
            now_ns = time.monotonic_ns()
            self._callback(now_ns)
            if self._timer is not None:  # the callback may have ended it
                self._arm(timer, now_ns)
