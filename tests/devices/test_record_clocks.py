"""A sensor's time from its records' numbers, their stamps, or their count."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.devices.record_clocks import CountingClock, SequenceClock, StampClock

MS = 1_000_000


@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.integers(1, 200), min_size=1, max_size=50),
    st.sampled_from([805.6, 1000.0, 7000.0]),
)
def test_lost_records_shift_no_time(first, steps, rate_hz):
    clock = SequenceClock(rate_hz, Counter())
    number, index = first, 0
    assert clock.stamp(first, 0) == 0
    for step in steps:
        number, index = (number + step) % 2**32, index + step
        arrival_ns = round(index * 1e9 / rate_hz)
        assert clock.stamp(number, arrival_ns) == arrival_ns
    assert clock.faults["lost record"] == sum(steps) - len(steps)


def test_late_and_doubled_records_are_left_out_and_counted():
    clock = SequenceClock(1000.0, Counter())
    times = [clock.stamp(number, 10 * MS) for number in (5, 7, 6, 7, 8)]
    assert times == [0, 2 * MS, None, None, 3 * MS]
    assert clock.faults == {"lost record": 1, "late record": 2}


@pytest.mark.parametrize("wrong", [5 ^ (1 << 31), 5 ^ (1 << 20), 5 ^ (1 << 12)])
def test_a_flipped_bit_does_not_move_the_clock(wrong):
    clock = SequenceClock(1000.0, Counter())
    assert clock.stamp(4, 0) == 0
    assert clock.stamp(wrong, 1 * MS) is None
    assert clock.stamp(6, 2 * MS) == 2 * MS
    assert clock.faults == {"impossible number": 1, "lost record": 1}


def test_time_goes_on_by_the_hosts_when_the_sensor_counts_anew():
    clock = SequenceClock(1000.0, Counter())
    for i in range(5000):
        clock.stamp(i, i * MS)
    times = [clock.stamp(i, (7000 + i) * MS) for i in range(10)]
    assert times[:4] == [None] * 4
    assert times[4:] == [(7000 + i) * MS for i in range(4, 10)]
    assert clock.faults["counted anew"] == 1


@pytest.mark.parametrize(
    ("number", "at_ms", "expected_ms", "restarts", "lost"),
    [(1, 600, 600, 1, 0), (300, 303, 300, 0, 200)],
    ids=["counts anew", "went on"],
)
def test_an_interrupted_stream_is_believed_at_once(number, at_ms, expected_ms, restarts, lost):
    clock = SequenceClock(1000.0, Counter())
    for i in range(100):
        clock.stamp(i, i * MS)
    clock.interrupt()
    assert clock.stamp(number, at_ms * MS) == expected_ms * MS
    assert (clock.faults["counted anew"], clock.faults["lost record"]) == (restarts, lost)


def fed(clock, stamps_us, period_ms=1.0):
    """Stamps that arrive evenly."""
    return [clock.stamp(us, round(i * period_ms * MS)) for i, us in enumerate(stamps_us)]


def test_stamps_go_on_across_the_wrap_around():
    clock = StampClock(Counter())
    first = 2**32 - 2000
    times = fed(clock, [(first + 1000 * i) % 2**32 for i in range(20)])
    assert times == [(first + 1000 * i) * 1000 for i in range(20)]
    assert clock.period_ns == MS
    assert not clock.faults.total()


@given(st.lists(st.integers(1, 50), min_size=1, max_size=30))
def test_what_lies_between_two_stamps_is_counted(steps):
    clock = StampClock(Counter())
    fed(clock, [1000 * i for i in range(20)])
    stamp, now_ns = 19_000, 19 * MS
    for step in steps:
        stamp, now_ns = stamp + 1000 * step, now_ns + step * MS
        assert clock.stamp(stamp, now_ns) == 1000 * stamp
    assert clock.faults["lost frame"] == sum(steps) - len(steps)


def test_records_that_waited_in_the_host_keep_their_times():
    clock = StampClock(Counter())
    times = [clock.stamp(1000 * i, 10 * 1000 * MS) for i in range(1, 200)]  # all at once
    assert times == [MS * i for i in range(1, 200)]
    assert not clock.faults["restart"]


def test_a_stamp_that_comes_twice_is_left_out_and_one_that_starts_again_continues_the_time():
    clock = StampClock(Counter())
    assert fed(clock, [5_000_000, 5_001_000, 5_001_000]) == [5000 * MS, 5001 * MS, None]
    assert clock.faults["repeated frame"] == 1
    assert clock.stamp(400, 10 * MS) == 5001 * MS + 8 * MS
    assert clock.stamp(1400, 11 * MS) == 5001 * MS + 9 * MS
    assert clock.faults["restart"] == 1


def test_after_an_interruption_what_has_passed_counts_and_nothing_is_lost():
    clock = StampClock(Counter())
    times = fed(clock, [1000 * i for i in range(20)])
    clock.interrupt()
    assert clock.stamp(77, 5019 * MS) == times[-1] + 5000 * MS
    assert clock.stamp(1077, 5020 * MS) == times[-1] + 5001 * MS
    assert not clock.faults.total()


def feed(clock, arrivals):
    """Count records that come in bundles (how many, when in ms); return the times of all."""
    times = []
    for records, at_ms in arrivals:
        clock.arrive(records, at_ms * MS)
        times += [clock.next() for _ in range(records)]
    return times


@pytest.mark.parametrize(
    ("arrivals", "last_ms", "missing"),
    [
        ([(2, 0), (2, 2), (2, 4)], 5, 0),
        ([*[(1, t) for t in range(1, 50)], *[(1, t) for t in range(150, 300)]], 298, 100),
        *[
            ([(1, 1), (1, 2), (40, 100), (58, 100 + late), (160, 260), (1, 261), (1, 262)], 261, 0)
            for late in (0, 1, 30)
        ],
        ([(49, 50 * i) for i in range(1, 200)], 49 * 199 - 1, 0),
    ],
    ids=["even", "swallowed", "held back", "held back by 1", "held back by 30", "slower"],
)
def test_records_without_numbers_are_counted_with_what_a_silence_has_swallowed(
    arrivals, last_ms, missing
):
    clock = CountingClock(1000.0, Counter(), "lost")
    times = feed(clock, arrivals)
    assert (times[0], times[-1], clock.faults["lost"]) == (0, last_ms * MS, missing)
    clock.interrupt()
    at_ms = arrivals[-1][1] + 500
    assert feed(clock, [(2, at_ms)])[-1] == times[-1] + 500 * MS  # by the host's time
