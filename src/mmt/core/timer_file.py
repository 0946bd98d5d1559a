"""A kernel timer (timerfd) that wakes an event loop; asyncio rounds its timers up to 1 ms."""

import ctypes
import os
import sys
import time


class TimerFile:
    """A kernel timer (timerfd) on the monotonic clock, read without blocking."""

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
