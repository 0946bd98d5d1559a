"""Sequence numbers: how far apart, sets of them as ranges, and how fast a sender's may grow."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from typing import Final, TypeVar

from mmt.core.arrays import IntArray

SEQUENCES: Final = 2**32
"""Sequence numbers have 32 bits: they start again at 0 after 49 days at 1 kHz."""

Number = TypeVar("Number", int, IntArray)

Range = tuple[int, int]
"""The numbers from the first up to, but not including, the second."""

_MARGIN_NS: Final = 2_000_000_000
"""Time by which a sender may be ahead of the clock, as in a burst after a network stall."""

_CATCH_UP_FACTOR: Final = 2
"""How many times faster than its rate a sender may be while it catches up."""


def steps_ahead(number: Number, newest: int) -> Number:
    """Return how far numbers are ahead of the newest one, negative if they are behind.

    The numbers wrap at `SEQUENCES`, and the shorter way round counts (RFC 1982).
    """
    return (number - newest + SEQUENCES // 2) % SEQUENCES - SEQUENCES // 2


class RangeSet:
    """A set of whole numbers as ascending ranges that neither overlap nor touch.

    Every operation takes O(n) in the number of ranges, most of it a move of memory.

    Parameters
    ----------
    ranges
        Initial content.
    """

    def __init__(self, ranges: Iterable[Range] = ()) -> None:
        self._starts: list[int] = []
        self._stops: list[int] = []
        for first, stop in ranges:
            self.add(first, stop)

    def __iter__(self) -> Iterator[Range]:
        return iter(zip(self._starts, self._stops, strict=True))

    def __len__(self) -> int:
        """Return how many ranges there are."""
        return len(self._starts)

    def __contains__(self, number: int) -> bool:
        place = bisect_right(self._starts, number) - 1
        return place >= 0 and number < self._stops[place]

    @property
    def first(self) -> int | None:
        """The smallest number, or None if the set is empty."""
        return self._starts[0] if self._starts else None

    @property
    def count(self) -> int:
        """How many numbers there are."""
        return sum(self._stops) - sum(self._starts)

    def add(self, first: int, stop: int) -> int:
        """Add the numbers from `first` up to `stop`; return how many were new."""
        if first >= stop:
            return 0
        new = stop - first - self.within(first, stop).count
        low = bisect_left(self._stops, first)
        high = bisect_right(self._starts, stop)
        if low < high:
            first = min(first, self._starts[low])
            stop = max(stop, self._stops[high - 1])
        self._starts[low:high] = [first]
        self._stops[low:high] = [stop]
        return new

    def remove(self, first: int, stop: int) -> int:
        """Remove the numbers from `first` up to `stop`; return how many there were."""
        low = bisect_right(self._stops, first)
        high = bisect_left(self._starts, stop)
        if first >= stop or low >= high:
            return 0
        begin, end = self._starts[low], self._stops[high - 1]
        before = sum(self._stops[low:high]) - sum(self._starts[low:high])
        left = [r for r in ((begin, min(first, end)), (max(stop, begin), end)) if r[0] < r[1]]
        self._starts[low:high] = [r[0] for r in left]
        self._stops[low:high] = [r[1] for r in left]
        return before - sum(b - a for a, b in left)

    def within(self, first: int, stop: int) -> "RangeSet":
        """Return the numbers of this set from `first` up to `stop`."""
        found = RangeSet()
        low = bisect_right(self._stops, first)
        high = bisect_left(self._starts, stop)
        if first < stop and low < high:
            found._starts = self._starts[low:high]
            found._stops = self._stops[low:high]
            found._starts[0] = max(found._starts[0], first)
            found._stops[-1] = min(found._stops[-1], stop)
        return found

    def clear(self) -> None:
        """Remove everything."""
        self._starts.clear()
        self._stops.clear()


def ranges_of(numbers: IntArray) -> list[Range]:
    """Return the ranges that ascending whole numbers (n,) form."""
    ranges: list[Range] = []
    for number in numbers.tolist():
        if ranges and ranges[-1][1] == number:
            ranges[-1] = (ranges[-1][0], number + 1)
        else:
            ranges.append((number, number + 1))
    return ranges


def shortest_period_ns(rate_hz: float, fastest: float) -> int:
    """Return the shortest mean time (ns) between two records.

    Parameters
    ----------
    rate_hz
        Records a second in real time.
    fastest
        How many times faster than real time the sender may stream.
    """
    return max(1, round(1e9 / (rate_hz * fastest * _CATCH_UP_FACTOR)))


def largest_advance(silence_ns: int, shortest_ns: int) -> int:
    """Return how far the sequence numbers may advance during a silence of this length (ns)."""
    return (silence_ns + _MARGIN_NS) // shortest_ns


class JumpBound:
    """Bound the growth of sequence numbers by the time that passes at the receiver.

    A token bucket in units of time, filled by the clock. Each number costs the shortest period,
    so that in the long run a sender is at most that fast, and at most two seconds ahead once.
    A silence fills the bucket further; the surplus drains while records arrive, so that a burst
    after a network stall still passes. If the clock jumps back, the bucket moves with it. Takes
    a few integer operations for each record, no division.

    Parameters
    ----------
    shortest_ns
        See `shortest_period_ns`.
    """

    def __init__(self, shortest_ns: int) -> None:
        self._shortest_ns = shortest_ns
        self._drain_ns = 2 * shortest_ns
        self._due_ns = -_MARGIN_NS
        self._arrival_ns = 0

    def restart(self, arrival_ns: int) -> None:
        """Start again from the record that arrives now."""
        self._due_ns = arrival_ns - _MARGIN_NS
        self._arrival_ns = arrival_ns

    def permits(self, ahead: int, arrival_ns: int) -> bool:
        """Return whether a number this far ahead of the newest is plausible; charge nothing."""
        jumped_ns = max(0, self._arrival_ns - arrival_ns)
        return self._due_ns - jumped_ns + ahead * self._shortest_ns <= arrival_ns

    def allows(self, ahead: int, arrival_ns: int) -> bool:
        """Return whether a number this far ahead of the newest is plausible; if so, charge it."""
        if arrival_ns < self._arrival_ns:
            self._due_ns -= self._arrival_ns - arrival_ns
        self._arrival_ns = arrival_ns
        due_ns = self._due_ns + ahead * self._shortest_ns
        if due_ns > arrival_ns:
            return False
        above_ns = arrival_ns - _MARGIN_NS - due_ns
        if above_ns > 0:
            due_ns += above_ns if above_ns < self._drain_ns else self._drain_ns
        self._due_ns = due_ns
        return True
