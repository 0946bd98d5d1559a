"""Ranges of numbers behave as the sets that they stand for."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.sequence_numbers import Range, RangeSet, ranges_of

bounds = st.integers(0, 60)
operations = st.lists(st.tuples(st.sampled_from(["add", "remove"]), bounds, bounds), max_size=40)


@settings(max_examples=300, deadline=None)
@given(operations, bounds, bounds)
def test_ranges_are_the_sets_that_they_stand_for(
    changes: list[tuple[str, int, int]], first: int, stop: int
) -> None:
    ranges, oracle = RangeSet(), set[int]()
    for name, low, high in changes:
        numbers = set(range(low, high))
        if name == "add":
            assert ranges.add(low, high) == len(numbers - oracle)
            oracle |= numbers
        else:
            assert ranges.remove(low, high) == len(numbers & oracle)
            oracle -= numbers
        listed = list(ranges)
        assert {number for r in listed for number in range(*r)} == oracle
        assert all(low < high for low, high in listed)
        assert all(before[1] < after[0] for before, after in pairwise(listed))
        assert ranges.count == len(oracle)
        assert ranges.first == min(oracle, default=None)
        assert len(ranges) == len(listed)
    assert [number in ranges for number in range(62)] == [n in oracle for n in range(62)]
    part = oracle & set(range(first, stop))
    within = ranges.within(first, stop)
    assert {number for r in within for number in range(*r)} == part
    assert list(RangeSet(within)) == list(within)
    assert ranges.count == len(oracle), "a part must not share what it is a part of"


@given(st.sets(st.integers(0, 100)))
def test_ascending_numbers_form_ranges(numbers: set[int]) -> None:
    ranges: list[Range] = ranges_of(np.array(sorted(numbers), dtype=np.int64))
    assert [number for r in ranges for number in range(*r)] == sorted(numbers)
    assert all(before[1] < after[0] for before, after in pairwise(ranges))


def test_an_empty_set_is_cleared_and_filled_anew() -> None:
    ranges = RangeSet([(3, 5), (7, 9)])
    ranges.clear()
    assert (ranges.first, ranges.count, list(ranges)) == (None, 0, [])
    assert ranges.add(4, 4) == 0
    assert ranges.add(4, 6) == 2
    assert ranges.remove(5, 5) == 0
    assert list(ranges) == [(4, 6)]
