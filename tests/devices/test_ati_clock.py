"""A sensor's time from its records' numbers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.devices.record_clocks import SequenceClock

MS = 1_000_000


def test_numbers_become_times_across_the_wrap_around():
    clock = SequenceClock(1000.0)
    numbers = [0xFFFFFFFE, 0xFFFFFFFF, 0, 1]
    times = [clock.stamp(number, i * MS) for i, number in enumerate(numbers)]
    assert times == [0, MS, 2 * MS, 3 * MS]
    assert (clock.lost, clock.late, clock.strange, clock.restarts) == (0, 0, 0, 0)


@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.integers(1, 200), min_size=1, max_size=50),
    st.sampled_from([805.6, 1000.0, 7000.0]),
)
def test_lost_records_shift_no_time(first, steps, rate_hz):
    clock = SequenceClock(rate_hz)
    number, index = first, 0
    assert clock.stamp(first, 0) == 0
    for step in steps:
        number, index = (number + step) % 2**32, index + step
        arrival_ns = round(index * 1e9 / rate_hz)
        assert clock.stamp(number, arrival_ns) == arrival_ns
    assert clock.lost == sum(steps) - len(steps)


def test_late_and_doubled_records_are_left_out_and_counted():
    clock = SequenceClock(1000.0)
    times = [clock.stamp(number, 10 * MS) for number in (5, 7, 6, 7, 8)]
    assert times == [0, 2 * MS, None, None, 3 * MS]
    assert (clock.lost, clock.late) == (1, 2)


@pytest.mark.parametrize("wrong", [5 ^ (1 << 31), 5 ^ (1 << 20), 5 ^ (1 << 12)])
def test_a_flipped_bit_does_not_move_the_clock(wrong):
    clock = SequenceClock(1000.0)
    assert clock.stamp(4, 0) == 0
    assert clock.stamp(wrong, 1 * MS) is None
    assert clock.stamp(6, 2 * MS) == 2 * MS
    assert (clock.strange, clock.lost) == (1, 1)


def test_time_goes_on_by_the_hosts_when_the_sensor_counts_anew():
    clock = SequenceClock(1000.0)
    for i in range(5000):
        clock.stamp(i, i * MS)
    times = [clock.stamp(i, (7000 + i) * MS) for i in range(10)]
    assert times[:4] == [None] * 4
    assert times[4:] == [(7000 + i) * MS for i in range(4, 10)]
    assert clock.restarts == 1


def test_an_interrupted_stream_is_believed_at_once():
    clock = SequenceClock(1000.0)
    for i in range(100):
        clock.stamp(i, i * MS)
    clock.interrupt()
    assert clock.stamp(1, 600 * MS) == 600 * MS


def test_an_interrupted_stream_that_went_on_keeps_its_count():
    clock = SequenceClock(1000.0)
    for i in range(100):
        clock.stamp(i, i * MS)
    clock.interrupt()
    assert clock.stamp(300, 303 * MS) == 300 * MS
    assert (clock.restarts, clock.lost) == (0, 200)
