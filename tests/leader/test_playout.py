import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.leader.output.concealment import build_concealment
from mmt.leader.output.stream import PlayoutBuffer, PlayoutStatistics

MS = 1_000_000


def play(buffer, frames, ticks, start_ns=0):
    """Feed (sequence, time, arrival, value) by arrival while the clock ticks."""
    waiting = sorted(frames, key=lambda frame: frame[2])
    output = []
    for tick in range(ticks):
        now = start_ns + tick * MS
        while waiting and waiting[0][2] <= now:
            *frame, value = waiting.pop(0)
            buffer.push(*frame, (value,))
        output.extend(buffer.pull(now))
    return np.array(output)


def stream(count, delay_ms, jitter_ms=0.0, seed=0, offset_ns=0):
    generator = np.random.default_rng(seed)
    lateness = generator.uniform(0, jitter_ms, count) if jitter_ms else np.zeros(count)
    return [
        (k, k * MS + offset_ns, int((k + delay_ms + lateness[k]) * MS), float(k + 1))
        for k in range(count)
    ]


def test_the_automatic_delay_bridges_jitter():
    buffer = PlayoutBuffer("auto")
    play(buffer, stream(6000, 4.0, jitter_ms=8.0), 6000)
    statistics = buffer.statistics()
    assert 8 <= statistics.delay_ms <= 14
    bridged = statistics.bridged
    later = [(k + 6000, t + 6000 * MS, a + 6000 * MS, v) for k, t, a, v in stream(3000, 4.0, 8.0)]
    play(buffer, later, 2990, start_ns=6000 * MS)
    assert buffer.statistics().bridged - bridged < 60


def test_the_automatic_delay_is_bounded():
    buffer = PlayoutBuffer("auto", longest_delay_ms=20.0)
    play(buffer, stream(4000, 4.0, jitter_ms=80.0), 4000)
    assert buffer.statistics().delay_ms == 20.0


def test_a_fast_clock_is_followed_by_single_slips():
    frames = [(k, int(k * MS), int(k * MS * 0.999) + 3 * MS, float(k)) for k in range(8000)]
    buffer = PlayoutBuffer("auto")
    play(buffer, frames, 7900)
    assert buffer.statistics().resyncs == 0
    assert 3 <= buffer.statistics().slips <= 20


@settings(max_examples=30)
@given(
    st.lists(
        st.tuples(st.integers(0, 3000), st.integers(-(10**9), 10**12), st.integers(0, 10**10)),
        max_size=80,
    )
)
def test_any_frames_leave_the_output_bounded(frames):
    output = play(PlayoutBuffer("auto"), [(*frame, 1.0) for frame in frames], 400)
    assert (np.abs(output) <= 1.0).all()


@pytest.mark.parametrize("step_s", [10, -10, 0.5, -0.5])
@pytest.mark.parametrize("of_follower", [True, False])
def test_a_step_in_a_clock_is_not_heard(step_s, of_follower):
    step_ns = int(step_s * 1e9)
    start_ns = 20 * 10**9
    buffer = PlayoutBuffer("auto")
    output = []
    for k in range(6000):
        stepped = step_ns if k >= 3000 else 0
        leader_ns = start_ns + k * MS + (0 if of_follower else stepped)
        follower_ns = k * MS + (stepped if of_follower else 0)
        buffer.push(k, follower_ns, leader_ns + 3 * MS, (float(k + 1),))
        output.extend(buffer.pull(leader_ns + 3 * MS))
    steps = np.diff(output[100:])
    assert (steps == 1.0).mean() > 0.998
    assert buffer.statistics().bridged < 3
    assert buffer.statistics().delay_ms < 4


def test_late_frames_are_not_played_and_leave_no_longer_delay():
    def lateness_ms(k):
        return 2003 - (k - 3000) if 3000 <= k < 5000 else 3

    buffer = PlayoutBuffer("auto")
    frames = [(k, k * MS, (k + lateness_ms(k)) * MS, k + 1 / 3) for k in range(9000)]
    output = play(buffer, frames, 8900)
    heard = np.abs(output % 1 - 1 / 3) < 1e-6  # the others fade
    assert (np.arange(8900) - output)[heard].max() < 110  # the longest delay and the way
    assert (output[3020:5000] == 0.0).all()
    assert (output[5040:] > 0.0).all()
    assert buffer.statistics().delay_ms < 5


# frames arrive 3 ms late, so that at 5 ms tick t plays number t - 8


class Bare:
    """Plays what there is, -1 for what is missing, and 0 before there was anything."""

    def __init__(self, *, silent=False):
        self.silent = silent
        self._missing = (0.0,)

    def play(self, values):
        self._missing = (-1.0,)
        return values

    def bridge(self):
        return self._missing


def steady(ticks, *, silent=False):
    """Return a buffer of 5 ms after this many ticks, that has been given 1000 frames."""
    buffer = PlayoutBuffer(5.0, concealment=Bare(silent=silent))
    play(buffer, stream(1000, 3.0)[: ticks - 3], ticks)
    for k in range(ticks - 3, 1000):
        buffer.push(k, k * MS, (k + 3) * MS, (float(k + 1),))
    return buffer


@pytest.mark.parametrize("offset_ns", [0, 10**15, -(10**15)])
def test_each_sample_is_played_a_delay_after_the_quickest_frame(offset_ns):
    """The two clocks need not agree."""
    buffer = PlayoutBuffer(5.0, concealment=Bare())
    output = play(buffer, stream(1000, 3.0, offset_ns=offset_ns), 900)
    assert output.tolist() == [0.0] * 8 + [float(k + 1) for k in range(892)]
    assert buffer.statistics() == PlayoutStatistics(5.0, 892, 0, 0, 0, 0)
    at_its_turn = PlayoutBuffer(0.0, concealment=Bare())
    play(at_its_turn, stream(100, 3.0, offset_ns=offset_ns), 90)
    assert at_its_turn.statistics() == PlayoutStatistics(0.0, 87, 0, 0, 0, 0)  # none is late


def test_frames_after_their_turn_and_frames_that_never_come_are_counted():
    buffer = PlayoutBuffer(5.0, concealment=Bare())
    frames = [frame for frame in stream(500, 3.0) if frame[0] != 1]
    frames = [(k, t, a + (20 * MS if k in {100, 101, 102} else 0), v) for k, t, a, v in frames]
    output = play(buffer, frames, 400)
    assert buffer.statistics() == PlayoutStatistics(5.0, 388, 4, 3, 0, 0)
    assert np.flatnonzero(output == -1.0).tolist() == [9, 108, 109, 110]


def test_the_end_of_the_stream_is_bridged_for_the_longest_delay():
    buffer = PlayoutBuffer(5.0, concealment=Bare())
    output = play(buffer, stream(500, 3.0), 900)
    assert (buffer.statistics().played, buffer.statistics().bridged) == (500, 100)
    assert output[508:].max() <= 0.0  # nothing stale


@pytest.mark.parametrize(
    ("given", "delay_ms"),
    [
        ({}, 2.0),
        ({"delay_ms": 500.0}, 100.0),
        ({"delay_ms": -3.0}, 0.0),
        ({"delay_ms": 50.0, "longest_delay_ms": 0.1}, 1.0),
        ({"delay_ms": 4.0, "period_ns": 2 * MS}, 4.0),
    ],
)
def test_the_delay_before_the_first_frame(given, delay_ms):
    assert PlayoutBuffer(**given).statistics().delay_ms == delay_ms


def test_the_age_of_a_sample_counts_from_the_quickest_frame():
    buffer = PlayoutBuffer(5.0)
    assert buffer.age_ms(0) is None
    buffer.push(0, 0, 3 * MS, (1.0,))
    buffer.push(1, MS, 11 * MS, (1.0,))
    assert buffer.age_ms(None) is None
    assert buffer.age_ms(0) == 8.0
    assert buffer.age_ms(1_234_567) == 9.235


@pytest.mark.parametrize(("step_ns", "noticed"), [(100 * MS, False), (100 * MS + 1, True)])
def test_a_clock_has_stepped_where_it_is_more_than_100_ms_off(step_ns, noticed):
    follower = steady(500)
    follower.push(1000, 1000 * MS - step_ns, 1003 * MS, (1.0,))
    follower.pull(500 * MS)
    assert follower.statistics().resyncs == (not noticed)
    leader = steady(500)
    leader.pull(500 * MS + step_ns)
    assert (leader.age_ms(0) is None) == noticed


def test_a_gap_in_the_stream_is_no_step_of_a_clock():
    buffer = steady(500)
    buffer.push(1300, 1300 * MS, 1323 * MS, (1.0,))
    assert buffer.age_ms(0) == 8.0


@pytest.mark.parametrize(
    ("late_ms", "delay_ms"),
    [
        ([0.0] * 190 + [10.0] * 10, 12.0),
        ([0.0] * 197 + [10.0] * 3, 12.0),
        ([0.0] * 198 + [10.0] * 2, 12.0),
        ([0.0] * 199 + [10.0], 2.0),
        ([0.0, 1.5], 4.0),
        ([0.0, 500.0], 2.0),
    ],
)
def test_the_automatic_delay_is_judged_every_hundred_ticks(late_ms, delay_ms):
    buffer = PlayoutBuffer()
    for k, late in enumerate(late_ms):
        buffer.push(k, k * MS, k * MS + round(late * MS), (1.0,))
    for tick in range(99):
        buffer.pull(tick * MS)
    assert buffer.statistics().delay_ms == 2.0
    buffer.pull(99 * MS)
    assert buffer.statistics().delay_ms == delay_ms


def test_from_51_samples_on_the_playout_jumps():
    buffer, now = steady(500), 499 * MS
    for resyncs, jump_ms in ((0, 50), (1, 51), (2, -51)):
        now += (1 + jump_ms) * MS
        before = buffer.statistics()
        buffer.pull(now)
        after = buffer.statistics()
        turns = after.played + after.bridged - before.played - before.bridged
        assert (turns, after.resyncs) == (1, resyncs), "a jump leaves no tick without a turn"
        for _ in range(21 * 50):  # the 50 samples are worked off by slips
            now += MS
            buffer.push(now // MS, now, now + 3 * MS, (1.0,))
            buffer.pull(now)


@pytest.mark.parametrize(("jump_ms", "slips"), [(1, 0), (2, 1), (3, 2), (-1, 0), (-2, 1)])
def test_a_difference_of_two_samples_is_worked_off_every_twenty_ticks(jump_ms, slips):
    buffer, sign = steady(501), np.sign(jump_ms)
    played = [buffer.pull((501 + jump_ms + k) * MS) for k in range(60)]
    steps = np.diff([493.0, *np.ravel(played)])
    expected = np.ones(60)
    expected[[18, 38][:slips]] += sign  # in tick 520 and 540
    assert steps.tolist() == expected.tolist()
    assert buffer.statistics().slips == slips


@pytest.mark.parametrize(("jump_ms", "heard"), [(1, 494.0), (2, 496.0), (-2, 492.0)])
def test_in_silence_a_difference_of_two_samples_is_made_up_for_at_once(jump_ms, heard):
    buffer = steady(501, silent=True)
    assert buffer.pull((501 + jump_ms) * MS) == (heard,)
    assert buffer.statistics().slips == 0


@pytest.mark.parametrize("way", ["silence", "repetition", "model"])
@pytest.mark.parametrize("samples", [1, 4])
def test_a_delay_that_reaches_back_before_the_first_frame_plays_none(way, samples):
    buffer = PlayoutBuffer("auto", concealment=build_concealment(way, 1, samples))
    frames = [(k, k * MS, max(k, 99 if k else 0) * MS) for k in range(300)]  # held up after one
    for tick in range(300):
        for frame in frames:
            if frame[2] == tick * MS:
                buffer.push(*frame, [1.0] * samples)
        assert len(buffer.pull(tick * MS)) == samples
