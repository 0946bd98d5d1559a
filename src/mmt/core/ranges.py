"""Sets of sequence numbers, stored as ranges."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator

from mmt.core.arrays import IntArray

Range = tuple[int, int]
"""The numbers from the first up to, but not including, the second."""


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
