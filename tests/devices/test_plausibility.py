"""What is believed of a reading: that it is one, that a tip can be there, that it changes."""

import math
from itertools import count, islice, product
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.frames import LARGEST_QUANTITY
from mmt.devices.reading_checks import (
    JUMP,
    NOT_FINITE,
    OUT_OF_REACH,
    PlausibilityCheck,
    StuckCheck,
    gathered,
    measured,
)

STILL = (0.0, 0.0, 0.0)
MS = 1_000_000


@given(
    start=st.tuples(*[st.floats(-800.0, 800.0)] * 3),
    way=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda way: math.hypot(*way) > 0.1),
    steps_ms=st.lists(st.integers(0, 40), min_size=1, max_size=4),
    share=st.sampled_from([0.999, 1.001]),
)
def test_a_tip_goes_as_far_as_the_fastest_hand(start, way, steps_ms, share):
    """The time without sense counts up to 5 ms."""
    check, now_ns = PlausibilityCheck(), 10**12
    assert check.problem(start, STILL, now_ns) is None
    for step_ms in steps_ms[:-1]:
        now_ns += step_ms * MS
        assert check.problem((math.nan, 0.0, 0.0), STILL, now_ns) == NOT_FINITE
    reach_mm = 5.0 * max(1, min(sum(steps_ms), steps_ms[-1] + 5))
    x, y, z = (a + share * reach_mm / math.hypot(*way) * b for a, b in zip(start, way, strict=True))
    problem = check.problem((x, y, z), STILL, now_ns + steps_ms[-1] * MS)
    assert problem == (None if share < 1.0 else JUMP)
    assert check.position == ((x, y, z) if share < 1.0 else start)


def test_a_first_measurement_is_finite_and_within_reach():
    told = ((2000.0, None), (2000.1, OUT_OF_REACH), (math.inf, NOT_FINITE))
    for axis, sign, (value, problem) in product(range(3), (-1.0, 1.0), told):
        x, y, z = (sign * value if axis == k else 0.0 for k in range(3))
        assert PlausibilityCheck().problem((x, y, z), STILL, 0) == problem
        speed = None if math.isfinite(value) else NOT_FINITE
        assert PlausibilityCheck().problem(STILL, (x, y, z), 0) == speed


@given(
    st.tuples(*[st.floats(-4.0, 4.0)] * 3),
    st.sampled_from([math.nan, math.inf, -math.inf, 1e39]),
    st.integers(0, 2),
)
def test_a_reading_is_finite_and_within_what_a_leader_accepts(direction, bad, axis):
    value = [component * LARGEST_QUANTITY / 2 for component in direction]
    expected = math.hypot(*value) <= LARGEST_QUANTITY
    assert measured(tuple(value)) == (tuple(value) if expected else None)
    value[axis] = bad
    assert measured(tuple(value)) is None
    largest = [0.0, 0.0, 0.0]
    largest[axis] = LARGEST_QUANTITY
    assert measured(tuple(largest)) == tuple(largest)


@pytest.mark.parametrize(("each", "number"), [(0, 0), (1, 20), (3, 33)])
def test_readings_are_gathered_for_a_time_and_longer_until_they_are_enough(
    each, number, monkeypatch
):
    """At one call a millisecond, at least 20 over 10.5 ms, or what comes in 50.5 ms."""
    passed_s, readings = [100.0], count()
    clock = SimpleNamespace(monotonic=lambda: sum(passed_s), sleep=passed_s.append)
    monkeypatch.setattr("mmt.devices.reading_checks.time", clock)
    found = gathered(lambda: islice(readings, each), 20, 0.0105, 0.0505)
    assert found == list(range(each, each + number)), "the first call's are left out"
    assert len(passed_s) - 1 == (number // each if each else 51)


values = st.sampled_from([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (math.nan, 0.0, 0.0)])


@given(st.lists(st.tuples(values, st.integers(1, 40)), max_size=30), st.integers(0, 60))
def test_a_value_is_stuck_once_it_has_stayed_the_same_for_the_time_given(steps, longest_ns):
    check = StuckCheck(longest_ns)
    assert check.is_stuck is False
    now_ns, since_ns, last = 0, 0, None
    for value, passed_ns in steps:
        now_ns += passed_ns
        if value != last:
            last, since_ns = value, now_ns
        assert check.add(value, now_ns) == (0 < longest_ns <= now_ns - since_ns)


def test_a_stuck_value_stays_so_until_it_changes_whatever_the_clock_does():
    check = StuckCheck(10)
    assert check.recovers([(1.0,)])
    assert [check.add((1.0,), time_ns) for time_ns in (0, 9, 10, 3, 4)] == [0, 0, 1, 1, 1]
    assert not check.recovers([])
    assert not check.recovers([(1.0,), (1.0,)])
    assert check.recovers([(1.0,), (2.0,)])
    assert check.is_stuck is False
    assert [check.add((1.0,), time_ns) for time_ns in (5, 2, 11, 12)] == [0, 0, 0, 1]
    check = StuckCheck(1)
    assert [check.add((1.0,), time_ns) for time_ns in (0, 1)] == [0, 1]
