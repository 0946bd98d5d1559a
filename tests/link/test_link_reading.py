"""What arrives is checked against a plain model that remembers everything."""

import logging
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from link_samples import commands, frames

from mmt.core.frames import COMMAND_DTYPE, LARGEST_QUANTITY
from mmt.core.sequence_numbers import shortest_period_ns
from mmt.link.incoming import LATEST_NS, BlockReader


def reader():
    return BlockReader(frames(0).dtype, "frames")


def read(into, block):
    good = into.read((block.tobytes(),), 0)
    return [] if good is None else good["sequence"].tolist()


def test_a_good_block_passes_whole_and_cannot_be_changed():
    into, block = reader(), frames(0, 5)
    good = into.read((block.tobytes(),), 0)
    assert good is not None
    assert np.array_equal(good, block)
    with pytest.raises(ValueError, match="read-only"):
        good["sequence"] = 1
    assert (into.messages, into.records, into.bytes) == (1, 5, block.nbytes)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((), "not bytes"),
        ((frames(0).tobytes(), 1), "not bytes"),
        (("text",), "not bytes"),
        ((None,), "not bytes"),
        (([1, 2, 3],), "not bytes"),
        (({"a": 1},), "not bytes"),
        ((b"",), "size"),
        ((frames(0).tobytes()[:-1],), "size"),
        ((frames(0).tobytes() + b"\0",), "size"),
        ((commands(0).tobytes(),), "size"),
        ((frames(0, 101).tobytes(),), "too many"),
    ],
)
def test_malformed_events_are_counted_and_leave_no_trace(arguments, reason):
    into = reader()
    assert into.read(arguments, 0) is None
    assert into.rejected == {reason: 1}
    assert (into.messages, into.records, into.lost) == (0, 0, 0)
    assert read(into, frames(0, 100)) == list(range(100))


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("position_mm", (0.0, math.nan, 0.0), "not finite"),
        ("force_n", (0.0, 0.0, math.inf), "not finite"),
        ("force_n", (-math.inf, 0.0, 0.0), "not finite"),
        ("position_mm", (math.inf, -math.inf, 0.0), "not finite"),
        ("position_mm", 1.1e6, "out of range"),
        ("force_n", -1.1e6, "out of range"),
        ("force_n", np.finfo(np.float32).max, "out of range"),
        ("time_ns", -1, "time out of range"),
        ("time_ns", LATEST_NS, "time out of range"),
        ("time_ns", np.iinfo(np.int64).min, "time out of range"),
    ],
)
def test_what_nothing_can_measure_becomes_a_gap_and_extremes_are_taken(field, value, reason):
    into, block = reader(), frames(0, 4)
    block[field][2] = value
    for name in ("position_mm", "force_n"):
        block[name][:2] = ([0.0] * 3, [np.finfo(np.float32).smallest_subnormal] * 3)
    block["position_mm"][0, 0] = LARGEST_QUANTITY
    block["time_ns"][[0, 3]] = (0, LATEST_NS - 1)
    assert read(into, block) == [0, 1, 3]
    assert into.rejected == {reason: 1}
    assert (into.records, into.lost) == (3, 0)


SECOND = 1_000_000_000
PACE = shortest_period_ns(1000, 1.0)


def numbered(sequence):
    block = frames(0)
    block["sequence"] = sequence
    return block


def read_at(into, block, arrival_ns):
    good = into.read((block.tobytes(),), arrival_ns)
    return [] if good is None else good["sequence"].tolist()


def test_a_number_far_ahead_is_not_believed_and_does_no_harm():
    into = BlockReader(frames(0).dtype, "frames", PACE)
    assert read_at(into, frames(0, 10), 10 * SECOND) == list(range(10))
    for huge in (2**31 + 8, 2**31, 100_000, 4100):
        assert read_at(into, numbered(huge), 10 * SECOND) == []
    assert into.rejected == {"implausible jump": 4}
    assert into.lost == 0
    assert read_at(into, frames(10, 2), 10 * SECOND) == [10, 11]


def test_after_a_silence_as_much_is_believed_as_it_lasted():
    into = BlockReader(frames(0).dtype, "frames", PACE)
    read_at(into, frames(0), 10 * SECOND)
    assert read_at(into, numbered(601_000), 310 * SECOND) == [601_000]
    assert into.lost == 600_999
    assert read_at(into, numbered(610_000), 311 * SECOND) == []


def test_a_clump_after_a_stall_passes():
    into = BlockReader(frames(0).dtype, "frames", PACE)
    read_at(into, frames(0), 10 * SECOND)
    for first in range(1, 5901, 100):
        assert len(read_at(into, frames(first, 100), 16 * SECOND)) == 100


@given(st.lists(st.tuples(st.integers(0, 2**32 - 1), st.integers(0, SECOND)), max_size=60))
def test_numbers_never_outrun_twice_the_pace(arrivals):
    into = BlockReader(frames(0).dtype, "frames", PACE)
    now_ns, start_ns, advance = 10 * SECOND, 0, 0
    passed = []
    for sequence, silence_ns in arrivals:
        now_ns += silence_ns
        passed += read_at(into, numbered(sequence), now_ns)
        start_ns = start_ns or (now_ns if passed else 0)
        advance = int(sum(np.diff(passed) % 2**32))  # numbers may wrap
        if passed:
            assert advance <= 2 * (now_ns - start_ns + 2 * SECOND) / 1e6
    assert into.lost <= advance


def test_after_the_clock_jumped_back_frames_are_believed_as_far_as_before():
    into, hour_ns = reader(), 3600 * 10**9
    for number in range(10):
        assert read_at(into, numbered(number), hour_ns + number * 10**6) == [number]
    assert into.is_plausible(11, 10**9)
    assert not into.is_plausible(10**6, 10**9)
    for number in range(10, 20):
        assert read_at(into, numbered(number), 10**9 + number * 10**6) == [number]
    assert read_at(into, numbered(10**6), 10**9 + 21 * 10**6) == []


def test_a_message_from_the_future_with_a_number_of_long_ago_counts_anew():
    """Late and repeated records are of the past, whatever their number."""
    into = BlockReader(frames(0).dtype, "frames", PACE)
    for first in range(0, 1000, 100):
        read_at(into, frames(first, 100, time_ns=first + 1), 10 * SECOND)
    assert read_at(into, frames(0, 5, time_ns=900), 10 * SECOND) == []
    assert read_at(into, frames(800, 5, time_ns=2000), 10 * SECOND) == []  # not so long ago
    mixed = np.concatenate([frames(1000, 1, time_ns=2000), frames(0, 2, time_ns=2001)])
    assert read_at(into, mixed, 10 * SECOND) == [1000]
    assert read_at(into, frames(2, 3, time_ns=2003), 10 * SECOND) == [2, 3, 4]
    assert read_at(into, frames(5, 3, time_ns=2004), 10 * SECOND) == [5, 6, 7]
    assert into.lost == 0
    assert into.out_of_order + into.repeated == 5 + 5 + 2


@pytest.mark.parametrize(("number", "passes"), [(45, False), (44, True), (600, True)])
def test_a_number_of_which_the_newest_256_tell_nothing_is_the_newest(number, passes):
    into = BlockReader(frames(0).dtype, "frames", PACE)
    read_at(into, frames(300, time_ns=1), 10 * SECOND)
    for time_ns, passed in ((2, passes), (3, False)):
        assert read_at(into, frames(number, time_ns=time_ns), 10 * SECOND) == [number] * passed
    assert (into.repeated, into.out_of_order) == ((1, 0) if passes else (1, 1))


def test_counting_anew_takes_its_time_as_well():
    into = BlockReader(frames(0).dtype, "frames", PACE)
    passed = [n for n in range(5000) if read_at(into, frames(n, time_ns=n + 1), 10 * SECOND)]
    assert 1000 < len(passed) < 5000
    assert read_at(into, frames(0, time_ns=6000), 10 * SECOND) == []
    assert into.rejected["implausible restart"] == 1
    assert read_at(into, frames(0, time_ns=6000), 11 * SECOND) == [0]


def test_counting_anew_again_and_again_does_not_outrun_the_pace():
    into = BlockReader(frames(0).dtype, "frames", PACE)
    passed = []
    for turn in range(100):
        for number in (0, 3000):
            passed += read_at(into, frames(number, time_ns=len(passed) + 1), 10 * SECOND + turn)
    assert len(passed) < 5


def test_a_follower_that_comes_back_too_far_ahead_is_a_new_one():
    into = BlockReader(frames(0).dtype, "frames", PACE)
    read_at(into, frames(0, 10), 10 * SECOND)
    into.restart()
    assert read_at(into, numbered(1_000_000), 11 * SECOND) == [1_000_000]
    assert into.lost == 0


@given(
    st.lists(st.lists(st.integers(0, 40), min_size=1, max_size=6), min_size=1, max_size=30),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=200)
def test_order_agrees_with_a_model_that_remembers_everything(messages, offset):
    into = reader()
    passed = []
    for message in messages:
        block = frames(0, len(message))
        block["sequence"] = (np.array(message) + offset) % 2**32
        passed += read(into, block)
    flat = [number + offset for message in messages for number in message]
    seen = set()
    expected, repeated, late = [], 0, 0
    for number in flat:
        if not expected or number > expected[-1]:
            expected.append(number)
        elif number in seen:
            repeated += 1
        else:
            late += 1
        seen.add(number)
    assert passed == [number % 2**32 for number in expected]
    assert (into.repeated, into.out_of_order) == (repeated, late)
    assert into.lost == expected[-1] - expected[0] + 1 - len(expected)


def test_a_number_from_very_long_ago_is_out_of_order():
    into = reader()
    assert read(into, numbered(2**31 - 1)) == [2**31 - 1]
    assert read(into, frames(0)) == []
    assert (into.out_of_order, into.repeated) == (1, 0)


def test_the_end_tells_what_was_lost_last():
    into = reader()
    into.end(0, 0)
    assert (into.lost, into.rejected) == (0, {})
    read(into, frames(0, 10))
    into.end(10, 0)
    assert into.lost == 0
    into.end(9, 0)
    assert into.lost == 0
    into.end(13, 0)
    assert into.lost == 3
    other = reader()
    other.end(4, 0)
    assert other.lost == 4
    last = reader()
    read(last, numbered(2**32 - 1))
    last.end(2**32, 0)
    assert (last.lost, last.rejected) == (0, {})
    for sent in (10**30, 2**32 + 1, -1):
        last.end(sent, 0)
    assert last.lost == 0
    assert last.rejected == {"implausible count": 3}


def test_what_is_read_and_lost_adds_up_over_messages():
    into = reader()
    blocks = [frames(0), frames(2, 3), frames(9), frames(20, 2)]
    for block in blocks:
        assert into.read((block.tobytes(),), 0) is not None
    assert (into.messages, into.records) == (4, 7)
    assert into.bytes == sum(block.nbytes for block in blocks)
    assert into.lost == 1 + 4 + 10
    into.end(25, 0)
    assert into.lost == 15 + 3
    assert into.read((frames(20, 2).tobytes(),), 0) is None
    into.restart()
    assert into.read((frames(30).tobytes(),), 0) is not None
    assert (into.records, into.lost) == (8, 18 + 8)


def test_after_a_break_the_next_number_and_the_same_again_are_taken():
    """The next goes on without a loss; the same is that of another sender, which begins."""
    for number, lost in ((10, 0), (11, 1), (9, 0)):
        into = reader()
        read(into, frames(0, 10))
        into.restart()
        assert read(into, frames(number)) == [number]
        assert into.lost == lost


def test_how_many_may_have_been_sent_is_bounded_by_the_time():
    into = BlockReader(frames(0).dtype, "frames", shortest_ns=1_000_000)
    assert into.read((frames(0, 10).tobytes(),), 0) is not None
    assert into.is_plausible(0, 0)
    assert into.is_plausible(10, 0)
    most = next(sent for sent in range(10, 10_000) if not into.is_plausible(sent, 0)) - 1
    assert 1500 < most <= 2010
    into.end(most + 1, 0)
    assert (into.lost, into.rejected.pop("implausible count")) == (0, 1)
    late = 500_000_000
    assert into.is_plausible(most + 500, late)
    assert not into.is_plausible(most + 501, late)
    into.end(most, 0)
    assert (into.lost, into.rejected) == (most - 10, {})


def test_latency_is_measured_by_the_senders_clock_while_its_offset_is_known():
    into = reader()
    into.read((frames(0, time_ns=1_000_000).tobytes(),), 3_000_000)
    assert into.latency.count == 0
    into.use_clock_offset(5_000_000)
    into.read((frames(1, 2, time_ns=6_000_000).tobytes(),), 3_000_000)
    assert into.latency.count == 2
    assert into.latency.quantile_ms(0.5) == pytest.approx(2.0, rel=0.01)
    into.restart()
    into.read((frames(3).tobytes(),), 3_000_000)
    assert into.latency.count == 2


def test_commands_are_read_alike():
    into = BlockReader(COMMAND_DTYPE, "commands")
    block = commands(0, 3)
    block["echo_time_ns"] = np.iinfo(np.int64).max
    block["position_mm"][1, 2] = math.nan
    assert read(into, block) == [0, 2]


def test_a_flood_is_logged_once_a_second(caplog):
    into, told = reader(), []
    into.on_rejected = lambda reason, times: told.append((reason, times))
    with caplog.at_level(logging.WARNING, logger="mmt.link"):
        for _ in range(1000):
            into.read((b"x",), 0)
    assert into.rejected == {"size": 1000}
    assert 1 <= len(caplog.records) <= 5
    assert (told[0], len(told)) == (("size", 1), len(caplog.records))
    into.read(("text",), 0)
    assert told[-1] == ("not bytes", 1)
    assert caplog.records[0].getMessage() == "frames rejected: size (1 times)"
