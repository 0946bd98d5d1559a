"""A sensor's clock from its records: by the number or the time of each record, or by counting."""

import math
from collections import Counter
from typing import Final

_MODULUS: Final = 1 << 32
"""Numbers and stamps have 32 bits."""
_SLACK_NS: Final = 250_000_000
"""Largest lead of a record over the host's clock: records come in bursts."""
_BEHIND: Final = 1000
"""Records up to this many behind the newest are late ones, not a new count."""
_STRANGE_RUN: Final = 5
_LATE_RUN: Final = 50
"""Strange or late records in a row, numbered consecutively, that begin a new count."""


class SequenceClock:
    """Unwrap a record's number and turn it into the sensor's time.

    A number that the host's clock contradicts is rejected, since a flipped bit must not move
    the clock. If several rejected numbers in a row are consecutive, the sensor has restarted
    its count; its time is then continued by the time passed on the host.

    Parameters
    ----------
    rate_hz
        Records a second.
    faults
        Counts go here: ``lost record`` (its number was skipped, perhaps because it is late), ``late
        record`` (after a newer one, or twice), ``impossible number`` and ``counted anew``.
    """

    def __init__(self, rate_hz: float, faults: Counter[str]) -> None:
        self.period_ns = 1e9 / rate_hz
        self.faults = faults
        self._sequence: int | None = None
        self._index = 0
        self._arrival_ns = 0
        self._expected = -1
        self._agreeing = 0
        self._interrupted = False

    def interrupt(self) -> None:
        """Accept the next number without a check: the stream may have restarted."""
        self._interrupted = True

    def stamp(self, sequence: int, arrival_ns: int) -> int | None:
        """Return the sensor's time (ns) of a record, or None if it is late or strange.

        Parameters
        ----------
        sequence
            Number of the record, unsigned.
        arrival_ns
            Arrival time by the host's monotonic clock.
        """
        if self._sequence is None:
            return self._begin(sequence, arrival_ns)
        step = (sequence - self._sequence) % _MODULUS
        if self._interrupted:
            self._interrupted = False
            ahead_ns = step * self.period_ns - (arrival_ns - self._arrival_ns)
            if abs(ahead_ns) > _SLACK_NS:
                return self._begin(sequence, arrival_ns)
        if step != 1:
            if _MODULUS - step <= _BEHIND or step == 0:
                self.faults["late record"] += 1
                return self._doubt(sequence, arrival_ns, _LATE_RUN)
            if (step - 1) * self.period_ns > arrival_ns - self._arrival_ns + _SLACK_NS:
                self.faults["impossible number"] += 1
                return self._doubt(sequence, arrival_ns, _STRANGE_RUN)
            self.faults["lost record"] += step - 1
        self._agreeing = 0
        self._sequence = sequence
        self._index += step
        self._arrival_ns = arrival_ns
        return round(self._index * self.period_ns)

    def _doubt(self, sequence: int, arrival_ns: int, longest_run: int) -> int | None:
        self._agreeing = self._agreeing + 1 if sequence == self._expected else 1
        self._expected = (sequence + 1) % _MODULUS
        if self._agreeing < longest_run:
            return None
        return self._begin(sequence, arrival_ns)

    def _begin(self, sequence: int, arrival_ns: int) -> int:
        if self._sequence is not None:
            passed = round((arrival_ns - self._arrival_ns) / self.period_ns)
            self._index += max(1, passed)
            self.faults["counted anew"] += 1
        self._sequence = sequence
        self._arrival_ns = arrival_ns
        self._agreeing = 0
        return round(self._index * self.period_ns)


_LEARNT_STEPS: Final = 9
_LONG: Final = 1.5
"""Periods; in a longer step, records have been lost."""


class StampClock:
    """Unwrap a record's time stamp (us), and count the records missing between two.

    The period is learnt from the first steps. If a stamp is ahead of the time passed on the host,
    as after a restart, the sensor's time is continued by the time passed on the host.

    Parameters
    ----------
    faults
        Counts go here: ``lost frame``, ``repeated frame`` and ``restart``.
    """

    def __init__(self, faults: Counter[str]) -> None:
        self.period_ns = 0.0
        """Time between two records, 0 while it is not known."""
        self.faults = faults
        self._last_us: int | None = None
        self._time_ns = 0
        self._arrival_ns = 0
        self._steps: list[int] = []
        self._interrupted = False

    def interrupt(self) -> None:
        """Continue by the host's clock at the next record: the sensor may have restarted."""
        self._interrupted = True
        self.period_ns = 0.0
        self._steps.clear()

    def stamp(self, time_us: int, arrival_ns: int) -> int | None:
        """Return the sensor's time (ns) of a record, or None if it repeats the last stamp.

        Parameters
        ----------
        time_us
            Time stamp of the record.
        arrival_ns
            Arrival time by the host's monotonic clock.
        """
        last_us, self._last_us = self._last_us, time_us
        last_arrival_ns, self._arrival_ns = self._arrival_ns, arrival_ns
        if last_us is None:
            self._interrupted = False
            self._time_ns = time_us * 1000
            return self._time_ns
        step_ns = (time_us - last_us) % _MODULUS * 1000
        passed_ns = arrival_ns - last_arrival_ns
        if self._interrupted:
            self._interrupted = False
            self._time_ns += max(1000, passed_ns)
        elif step_ns == 0:
            self.faults["repeated frame"] += 1
            return None
        elif step_ns > passed_ns + _SLACK_NS:
            self.faults["restart"] += 1
            self._time_ns += max(1000, passed_ns)
        else:
            self._time_ns += step_ns
            self._learn(step_ns)
        return self._time_ns

    def _learn(self, step_ns: int) -> None:
        if self.period_ns:
            if step_ns > _LONG * self.period_ns:
                self.faults["lost frame"] += round(step_ns / self.period_ns) - 1
            return
        self._steps.append(step_ns)
        if len(self._steps) == _LEARNT_STEPS:
            self.period_ns = float(sorted(self._steps)[_LEARNT_STEPS // 2])


_SILENCE_NS: Final = 30_000_000
"""Shorter silences are caused by the line and the host."""
_BLOCK_NS: Final = 100_000_000
"""Time before a silence, and after it, over which the least lag is taken."""
_MISSING: Final = 0.3
"""Share of a silence: a smaller growth of the lag is caused by the host or an inexact rate."""


class CountingClock:
    """Count records, including those lost in a silence.

    The lag is how far the count is behind the host's clock. Records held back by a stall of the
    host or the line come later and leave the least lag as it was; lost records make it grow for
    good. Bytes lost without a silence make the clock late by a record at most each time; the
    estimate of this clock against the host's follows that.

    Parameters
    ----------
    rate_hz
        Records a second.
    faults, lost
        The records lost in silences are counted here, under this name.
    """

    def __init__(self, rate_hz: float, faults: Counter[str], lost: str) -> None:
        self.period_ns = 1e9 / rate_hz
        self.faults, self._lost = faults, lost
        self._index = -1
        self._arrival_ns: int | None = None
        self._interrupted = False
        self._block_ends_ns = 0
        self._least = math.inf  # lag in this block
        self._usual = math.inf  # least lag before
        self._silent_ns = 0  # in silences that are not judged yet

    def interrupt(self) -> None:
        """Continue by the host's clock at the next record."""
        self._interrupted = True

    def arrive(self, records: int, now_ns: int) -> None:
        """Note the arrival of records, before `next` counts them."""
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
        """Count a record and return its sensor time (ns)."""
        self._index += 1
        return round(self._index * self.period_ns)

    def _end_block(self, now_ns: int) -> None:
        grown_ns = self._least - self._usual  # -inf if there is no lag to compare with
        if self._silent_ns and grown_ns > _MISSING * self._silent_ns:
            lost = round(grown_ns / self.period_ns)
            self._index += lost
            self.faults[self._lost] += lost
            self._least -= lost * self.period_ns
        self._silent_ns = 0
        self._usual, self._least = self._least, math.inf
        self._block_ends_ns = now_ns + _BLOCK_NS
