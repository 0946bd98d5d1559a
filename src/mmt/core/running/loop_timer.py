"""A one-shot timer of the event loop that is more precise than the loop's own."""

import asyncio
import time
from collections.abc import Callable

from mmt.core.running.ticking import TimerFile, open_timer


class LoopTimer:
    """A precise timer of the running loop.

    Parameters
    ----------
    callback
        Called with the monotonic time (ns), once for each `set`.
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

    def set(self, at_ns: int) -> None:
        """Call back at a monotonic time (ns) in place of the one set before; 0 is never."""
        if at_ns == self._due_ns:
            return
        self._due_ns = at_ns
        if self._timer is not None:
            self._timer.arm(at_ns, 0)
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
