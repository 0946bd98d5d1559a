"""What a message costs, to the nanosecond: 100 us and 50 ns a byte at 1000 records a second."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.frames import MOST_SAMPLES, frame_dtype
from mmt.link.incoming import HANDSHAKE_MESSAGES, HandshakeLimit, PeriodLimit, RateLimit
from mmt.scene import LARGEST_SPEED

SECOND = 1_000_000_000
FULL = 199_998_000
"""Bytes of a message that costs 10 s, all that the bucket holds."""
HALF = 99_998_000
TOO_LONG = 2 * FULL
REPLAYED = round(LARGEST_SPEED) * frame_dtype(samples_per_frame=MOST_SAMPLES).itemsize + 40
"""Bytes of a millisecond of a replay of the largest frames at the largest speed."""


class Limited:
    """A limit whose drops and cut-offs are noted."""

    def __init__(self, rate_hz=1000.0):
        self.dropped = []
        self.exceeded = []
        self.limit = RateLimit(rate_hz, self.dropped.append, self.exceeded.append)

    def passes(self, *messages):
        """Offer messages of these sizes at these times."""
        return [self.limit.passes(size, now_ns) for size, now_ns in messages]


@pytest.mark.parametrize(
    ("messages_hz", "size"),
    [(1000, 100), (5000, 80), (9000, 60), (1000, 5000), (100, 100_000), (1000, REPLAYED)],
)
def test_what_a_session_sends_passes_for_ever(messages_hz, size):
    count = 20 * messages_hz
    assert all(Limited().passes(*((size, k * SECOND // messages_hz) for k in range(count))))


@given(st.lists(st.tuples(st.integers(0, SECOND // 10), st.integers(0, 131_072)), max_size=300))
def test_over_any_time_no_more_than_the_bound_passes(messages):
    peer, now_ns, passed = Limited(1.0), SECOND, list[int]()
    for silence_ns, size in messages:
        now_ns += silence_ns
        passed += [size] * peer.limit.passes(size, now_ns)
    elapsed_s = (now_ns - SECOND) / 1e9
    assert len(passed) <= 10 * (elapsed_s + 10)
    assert sum(passed) <= 20_000 * (elapsed_s + 10) * 1.001
    assert len(passed) + len(peer.dropped) == len(messages)


def test_the_bucket_holds_ten_seconds():
    assert Limited().passes((FULL, 0), (0, 0)) == [True, False]
    assert Limited().passes((FULL + 1, 0), (FULL, 0)) == [False, True]
    assert Limited().passes((FULL, 7), (0, 7 + 99_999), (0, 7 + 100_000)) == [True, False, True]
    again = Limited()
    assert again.passes((FULL, 0)) == [True]
    again.limit.open()  # another connection
    assert again.passes((0, 0)) == [False]


def test_a_message_and_its_bytes_always_cost_something():
    bytes_of_ten_seconds = (10 * SECOND - 1) * 1000  # 1 ps each, and 1 ns for the message
    fast = Limited(1e9)
    assert fast.passes((bytes_of_ten_seconds + 1000, 0), (bytes_of_ten_seconds, 0)) == [False, True]


def test_the_peer_is_cut_off_after_more_than_two_seconds_of_excess():
    peer = Limited()
    assert peer.limit.shut is False
    assert peer.passes((TOO_LONG, 5), (TOO_LONG, 5 + 2 * SECOND)) == [False, False]
    assert peer.limit.shut is False
    peer.passes((TOO_LONG, 6 + 2 * SECOND), (TOO_LONG, 7 + 2 * SECOND))
    assert peer.limit.shut is True
    assert len(peer.exceeded) == 1
    assert peer.dropped == ["too fast"] * 4
    peer.limit.open()
    assert peer.limit.shut is False
    peer.passes((TOO_LONG, 8 + 2 * SECOND), (TOO_LONG, 8 + 4 * SECOND))
    assert peer.limit.shut is False


def test_the_excess_is_over_once_the_bucket_is_less_than_half_full():
    for size, over in ((HALF, False), (HALF - 1, True)):
        peer = Limited()
        start = 100 * SECOND
        peer.passes((TOO_LONG, start), (size, start), (TOO_LONG, start + 2 * SECOND + 1))
        assert peer.limit.shut is not over


def test_a_clock_that_jumps_back_takes_the_bucket_along():
    peer = Limited()
    passed = peer.passes((FULL, 9 * SECOND), (0, SECOND), (0, SECOND + 100_000))
    assert passed == [True, False, True]
    peer = Limited()
    peer.passes((TOO_LONG, 9 * SECOND), (TOO_LONG, SECOND), (TOO_LONG, 3 * SECOND))
    assert peer.limit.shut is False
    peer.passes((TOO_LONG, 3 * SECOND + 1))
    assert peer.limit.shut is True


def test_the_bound_is_said_in_messages_and_megabytes():
    peer = Limited(100.0)
    peer.passes((TOO_LONG, 0), (TOO_LONG, 3 * SECOND))
    assert str(peer.exceeded[0]) == "it sent more than 1000 messages, or 2 MB, a second for 2 s"


def test_a_stranger_may_send_a_few_messages():
    stranger = HandshakeLimit()
    assert stranger.shut is False
    for _ in range(HANDSHAKE_MESSAGES):
        assert stranger.passes(10**9, 0) is True
        assert stranger.shut is False
    for _ in range(2):
        assert stranger.passes(1, 0) is False
        assert stranger.shut is True


def test_an_action_is_permitted_half_a_period_early_and_once_a_period_on_average():
    limit = PeriodLimit(4.0)
    permitted = {0.0: True, 1.9: False, 2.0: True, 5.9: False, 6.0: True}  # at 2, 6, 10, ...
    assert {now_s: limit.passes(now_s) for now_s in permitted} == permitted
    # what was not asked for in time is not made up for, but for half a period
    passed = [limit.passes(now_s) for now_s in (30.0, 30.0, 30.0, 33.9, 34.0)]
    assert passed == [True, True, False, False, True]
