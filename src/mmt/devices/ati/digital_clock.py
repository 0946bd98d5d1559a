"""A sensor's clock from the number of its records, where these carry none."""

from typing import Final

_SILENCE_NS: Final = 10_000_000
"""Shorter silences come from the line and the host."""
_MISSING: Final = 0.25
"""Of what must have come in a silence: less is a late delivery."""


class CountingClock:
    """Count records, also those that a silence has swallowed.

    Bytes that were lost without a silence make it late by a record at most each time; whoever
    compares it with another clock follows that.

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
        self._silence_ns = 0
        self._since = 0
        self._interrupted = False

    def interrupt(self) -> None:
        """Go on by what has passed on the host when the next record comes."""
        self._interrupted = True

    def arrive(self, records: int, now_ns: int) -> None:
        """Note that records are there, before they are counted.

        A silence is judged by the next ones after it, when what was held back has come.
        """
        if not records:
            return
        last_ns, self._arrival_ns = self._arrival_ns, now_ns
        if last_ns is None:
            return
        if self._interrupted:
            self._interrupted = False
            self._silence_ns = self._since = 0
            self._index += max(0, round((now_ns - last_ns) / self.period_ns) - records)
            return
        if now_ns - last_ns > _SILENCE_NS:
            self._silence_ns += now_ns - last_ns
            self._since += records
        elif self._silence_ns:
            expected = (self._silence_ns + now_ns - last_ns) / self.period_ns
            lost = round(expected) - self._since - records
            if lost > _MISSING * expected:
                self._index += lost
                self.missing += lost
            self._silence_ns = self._since = 0

    def next(self) -> int:
        """Count a record and return the sensor's time of it (ns)."""
        self._index += 1
        return round(self._index * self.period_ns)
