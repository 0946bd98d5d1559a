"""A sensor's clock from the number of its records, where these carry none."""

import math
from typing import Final

_SILENCE_NS: Final = 30_000_000
"""Shorter silences come from the line and the host."""
_BLOCK_NS: Final = 100_000_000
"""The least lag is taken of so long before a silence, and of so long after it."""
_MISSING: Final = 0.3
"""Of a silence: a lag that grew by less is the host's, or from another rate than nominal."""


class CountingClock:
    """Count records, also those that a silence has swallowed.

    The lag is how far the count is behind the host's clock. What a stall of the host or the line
    holds back comes later and leaves the least lag as it was; what is lost makes it grow for
    good. Bytes that were lost without a silence make the clock late by a record at most each
    time; whoever compares it with another clock follows that.

    Parameters
    ----------
    rate_hz
        Records a second.
    """

    def __init__(self, rate_hz: float) -> None:
        self.period_ns = 1e9 / rate_hz
        self.missing = 0
        """Records that a silence has swallowed."""
        self._index = -1
        self._arrival_ns: int | None = None
        self._interrupted = False
        self._block_ends_ns = 0
        self._least = math.inf  # lag in this block
        self._usual = math.inf  # least lag before
        self._silent_ns = 0  # in silences that are not judged yet

    def interrupt(self) -> None:
        """Go on by what has passed on the host when the next record comes."""
        self._interrupted = True

    def arrive(self, records: int, now_ns: int) -> None:
        """Note that records are there, before they are counted."""
        if not records:
            return
        last_ns, self._arrival_ns = self._arrival_ns, now_ns
        if last_ns is not None:
            pause_ns = now_ns - last_ns
            if self._interrupted:
                self._index += max(0, round(pause_ns / self.period_ns) - records)
                self._usual = self._least = math.inf
                self._silent_ns = 0
            elif pause_ns > _SILENCE_NS:
                if not self._silent_ns:
                    self._usual = min(self._usual, self._least)
                self._silent_ns += pause_ns
                self._least = math.inf
                self._block_ends_ns = now_ns + _BLOCK_NS
        self._interrupted = False
        self._least = min(self._least, now_ns - (self._index + records) * self.period_ns)
        if now_ns >= self._block_ends_ns:
            self._end_block(now_ns)

    def next(self) -> int:
        """Count a record and return the sensor's time of it (ns)."""
        self._index += 1
        return round(self._index * self.period_ns)

    def _end_block(self, now_ns: int) -> None:
        grown_ns = self._least - self._usual  # -inf where there is no lag to compare with
        if self._silent_ns and grown_ns > _MISSING * self._silent_ns:
            lost = round(grown_ns / self.period_ns)
            self._index += lost
            self.missing += lost
            self._least -= lost * self.period_ns
        self._silent_ns = 0
        self._usual, self._least = self._least, math.inf
        self._block_ends_ns = now_ns + _BLOCK_NS
