"""Ranges behave as the sets that they stand for; a sender's numbers grow as its rate allows."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.sequence_numbers import (
    SEQUENCES,
    JumpBound,
    RangeSet,
    largest_advance,
    ranges_of,
    shortest_period_ns,
    steps_ahead,
)

bounds = st.integers(0, 60)
operations = st.lists(st.tuples(st.sampled_from(["add", "remove"]), bounds, bounds), max_size=40)


@given(st.integers(0, SEQUENCES - 1), st.integers(-(2**31), 2**31 - 1))
def test_numbers_wrap_and_the_shorter_way_counts(newest, steps):
    assert str(steps_ahead((newest + steps) % SEQUENCES, newest)) == str(steps)


@settings(max_examples=300)
@given(operations, bounds, bounds)
def test_ranges_are_the_sets_that_they_stand_for(changes, first, stop):
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
def test_ascending_numbers_form_ranges(numbers):
    ranges = ranges_of(np.array(sorted(numbers), dtype=np.int64))
    assert [number for r in ranges for number in range(*r)] == sorted(numbers)
    assert all(before[1] < after[0] for before, after in pairwise(ranges))


def test_an_empty_set_is_cleared_and_filled_anew():
    ranges = RangeSet([(3, 5), (7, 9)])
    ranges.clear()
    assert (ranges.first, ranges.count, list(ranges)) == (None, 0, [])
    assert ranges.add(4, 4) == 0
    assert ranges.add(4, 6) == 2
    assert ranges.remove(5, 5) == 0
    assert list(ranges) == [(4, 6)]


def test_a_sender_may_be_twice_as_fast_as_its_rate_and_two_seconds_ahead():
    assert shortest_period_ns(1000.0, 1.0) == 500_000
    assert shortest_period_ns(0.01, 10.0) == 5_000_000_000
    assert shortest_period_ns(1e6, 1e6) == 1
    assert largest_advance(0, 500_000) == 4000
    assert largest_advance(1_000_000_000, 1_300_000) == 2307


def test_what_a_silence_adds_drains_by_two_periods_a_number():
    bound = JumpBound(1_000_000)
    bound.restart(0)
    assert bound.allows(1, 1_000_000_000)
    assert bound.permits(2997, 1_000_000_000)
    assert not bound.permits(2998, 1_000_000_000)
    bound.restart(0)
    assert bound.allows(1, 1_000_001)
    assert bound.permits(2001, 2_000_001)
    assert not bound.permits(2001, 2_000_000)


def test_a_clock_that_jumps_back_takes_the_bound_with_it():
    bound = JumpBound(1_000_000)
    bound.restart(5_000_000_000)
    assert bound.permits(2000, 4_000_000_000)
    assert not bound.permits(2001, 4_000_000_000)
    assert bound.allows(1, 4_000_000_000)
    assert bound.permits(1999, 4_000_000_000)
    assert not bound.permits(2000, 4_000_000_000)
