"""A sensor's clock from the number that each of its records carries."""

from typing import Final

_SLACK_NS: Final = 250_000_000
"""A number may be ahead of the host's clock by so much: records come in clumps."""
_BEHIND: Final = 1000
"""Records so far behind the newest are late ones, not a new count."""
_STRANGE_RUN: Final = 5
_LATE_RUN: Final = 50
"""So many strange or late records in a row that agree with one another begin a new count."""


class SequenceClock:
    """Unwrap a record's number and turn it into the sensor's time.

    A number that the host's clock contradicts is not believed, since a flipped bit must not
    move the clock. Where several in a row agree with one another, the sensor counts anew, as after
    its restart; its time then goes on by what has passed on the host.

    Parameters
    ----------
    rate_hz
        Records a second.
    bits
        Width of the number.
    """

    def __init__(self, rate_hz: float, bits: int = 32) -> None:
        self.period_ns = 1e9 / rate_hz
        self.lost = 0
        """Records that were numbered but did not come; one that comes late counts as lost."""
        self.late = 0
        """Records that came after a newer one, or twice."""
        self.strange = 0
        """Records whose number cannot be right."""
        self.restarts = 0
        self._modulus = 1 << bits
        self._sequence: int | None = None
        self._index = 0
        self._arrival_ns = 0
        self._expected = -1
        self._agreeing = 0
        self._interrupted = False

    def interrupt(self) -> None:
        """Believe the next number, whatever it is: the stream may have begun anew."""
        self._interrupted = True

    def stamp(self, sequence: int, arrival_ns: int) -> int | None:
        """Return the sensor's time (ns) of a record; None for one that is late or strange.

        Parameters
        ----------
        sequence
            Its number, unsigned.
        arrival_ns
            The host's monotonic time.
        """
        if self._sequence is None:
            return self._begin(sequence, arrival_ns)
        step = (sequence - self._sequence) % self._modulus
        if self._interrupted:
            self._interrupted = False
            ahead_ns = step * self.period_ns - (arrival_ns - self._arrival_ns)
            if abs(ahead_ns) > _SLACK_NS:
                return self._begin(sequence, arrival_ns)
        if step != 1:
            if self._modulus - step <= _BEHIND or step == 0:
                self.late += 1
                return self._doubt(sequence, arrival_ns, _LATE_RUN)
            if (step - 1) * self.period_ns > arrival_ns - self._arrival_ns + _SLACK_NS:
                self.strange += 1
                return self._doubt(sequence, arrival_ns, _STRANGE_RUN)
            self.lost += step - 1
        self._agreeing = 0
        self._sequence = sequence
        self._index += step
        self._arrival_ns = arrival_ns
        return round(self._index * self.period_ns)

    def _doubt(self, sequence: int, arrival_ns: int, longest_run: int) -> int | None:
        self._agreeing = self._agreeing + 1 if sequence == self._expected else 1
        self._expected = (sequence + 1) % self._modulus
        if self._agreeing < longest_run:
            return None
        return self._begin(sequence, arrival_ns)

    def _begin(self, sequence: int, arrival_ns: int) -> int:
        if self._sequence is not None:
            passed = round((arrival_ns - self._arrival_ns) / self.period_ns)
            self._index += max(1, passed)
            self.restarts += 1
        self._sequence = sequence
        self._arrival_ns = arrival_ns
        self._agreeing = 0
        return round(self._index * self.period_ns)
