"""Check whether a follower sends as many frames a second as it has promised."""

from collections.abc import Callable
from typing import Final

_WINDOW_NS: Final = 1_000_000_000
"""Length of a window: a wrong rate is off alike in two, a stall is made up in the second."""
_TOLERANCE: Final = 0.05


class FrameRateWatch:
    """Measure the rate of frames, and report if it is off by more than 5 % over two seconds.

    The rate follows from sequence numbers and time stamps. Lost frames therefore count and times
    of arrival do not: a network that stalls or loses frames does not change the rate.

    Parameters
    ----------
    promised_hz
        Frames a second, as in the follower's hello.
    say
        Called with a sentence when the rate is found to be off, and when it is right again.
    """

    def __init__(self, promised_hz: float, say: Callable[[str], None]) -> None:
        self._promised_hz = promised_hz
        self._say = say
        self._start: tuple[int, int] | None = None
        self._last_hz = promised_hz
        self.fault: str | None = None
        """The sentence while the rate is off, else None."""

    def restart(self) -> None:
        """Prepare for a new connection."""
        self._start, self._last_hz, self.fault = None, self._promised_hz, None

    def add(self, number: int, time_ns: int) -> None:
        """Take the newest frame's number and its own time, by the follower's clock."""
        if self._start is None or time_ns < self._start[1]:  # the first, or its clock jumped back
            self._start = number, time_ns
        first, start_ns = self._start
        passed_ns = time_ns - start_ns
        if passed_ns >= _WINDOW_NS:
            self._start = number, time_ns
            self._judge(1e9 * (number - first) / passed_ns)

    def _judge(self, rate_hz: float) -> None:
        """Compare the rates of the last two windows with the promised rate."""
        last_hz, self._last_hz = self._last_hz, rate_hz
        off, last_off = self._off(rate_hz), self._off(last_hz)
        if self.fault is not None and not off:
            self.fault = None
            self._say(f"frames come at the {self._promised_hz:g} Hz that the follower promised")
        elif self.fault is None and off and off == last_off:
            self.fault = (
                f"the follower promised {self._promised_hz:g} frames a second and sends "
                f"{(rate_hz + last_hz) / 2:.0f}: have it keep its schedule"
            )
            self._say(self.fault)

    def _off(self, rate_hz: float) -> int:
        """Return the direction in which a rate is off, 0 if it is right."""
        relative = rate_hz / self._promised_hz
        return (relative > 1.0 + _TOLERANCE) - (relative < 1.0 - _TOLERANCE)
