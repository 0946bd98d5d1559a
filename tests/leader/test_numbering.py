"""A session's frames are numbered on, whichever follower connects; their rate is watched."""

import numpy as np
import pytest
from frame_samples import PERIOD_NS, made_frames
from hypothesis import example, given
from hypothesis import strategies as st

from mmt.core.sequence_numbers import SEQUENCES, largest_advance, shortest_period_ns
from mmt.leader.numbering import FrameRateWatch, SessionNumbering

SECOND = 1_000_000_000


def test_a_follower_that_is_started_anew_is_put_behind_the_silence():
    numbering = SessionNumbering(PERIOD_NS)
    numbering.number(made_frames(0, 100), 5 * SECOND)
    numbering.reconnect()
    again = made_frames(0, 10)
    again["time_ns"] += 350 * PERIOD_NS  # the same machine's clock
    taken, left_out = numbering.number(again, 5 * SECOND + 250 * PERIOD_NS)
    assert left_out == 250
    assert taken["sequence"].tolist() == list(range(350, 360))
    np.testing.assert_array_equal(taken["time_ns"], again["time_ns"])
    np.testing.assert_array_equal(taken["force_n"], again["force_n"])
    assert again["sequence"][0] == 0, "the follower's own block must not change"
    following, left_out = numbering.number(made_frames(10, 2), 5 * SECOND + 260 * PERIOD_NS)
    assert (left_out, following["sequence"].tolist()) == (0, [360, 361])
    numbering.reconnect()  # it takes its link up again
    following, left_out = numbering.number(made_frames(14, 2), 5 * SECOND + 270 * PERIOD_NS)
    assert (left_out, following["sequence"].tolist()) == (0, [364, 365])


def test_another_process_is_told_by_its_name_whatever_it_counts():
    numbering = SessionNumbering(PERIOD_NS)
    numbering.reconnect("first")
    numbering.number(made_frames(0, 100), SECOND)
    numbering.reconnect("first")
    assert numbering.number(made_frames(200, 100), 2 * SECOND)[1] == 0
    numbering.reconnect("second")
    assert numbering.anew
    taken, left_out = numbering.number(made_frames(400, 10), 2 * SECOND + 50 * PERIOD_NS)
    assert left_out == 50
    assert taken["sequence"][0] == 350
    assert numbering.renumber(made_frames(410, 1))["sequence"][0] == 360
    assert numbering.shift == -50


def test_a_leader_that_was_paused_knows_the_follower_that_went_on():
    numbering = SessionNumbering(PERIOD_NS)
    numbering.reconnect("a")
    numbering.number(made_frames(0, 1000), SECOND)
    late = 6 * SECOND  # it was paused for 5 s, and reads what had arrived meanwhile
    numbering.number(made_frames(1000, 900), late)
    numbering.reconnect("a")
    again = made_frames(6900, 5)
    assert numbering.number(again, late + SECOND // 10) == (again, 0)
    assert not numbering.anew
    numbering.reconnect("a")
    _, left_out = numbering.number(made_frames(2**31 - 20, 5), late + SECOND)
    assert left_out, "the same process cannot have counted that far"


def test_before_the_first_frame_nothing_is_known():
    numbering = SessionNumbering(PERIOD_NS)
    known = (numbering.frames, numbering.newest, numbering.shift, numbering.anew)
    assert known == (0, -1, 0, False)
    assert (numbering.follower_time_ns, numbering.arrival_ns) == (0, 0)
    numbering.extend(50)
    assert (numbering.frames, numbering.newest) == (0, -1)
    numbering.reconnect("first")
    assert numbering.anew is False
    frames = made_frames(100_000, 3)
    assert numbering.number(frames, 5) == (frames, 0)
    assert numbering.frames == 3
    for stop in (100_050, 100_020):  # missing at the end
        numbering.extend(stop)
        assert (numbering.newest, numbering.frames) == (100_049, 50)


def test_a_late_frame_was_due_beside_the_newest_but_not_before_zero_or_after_now():
    numbering = SessionNumbering(PERIOD_NS)
    frames = made_frames(100, 10)
    numbering.number(frames, SECOND)
    newest_ns = int(frames["time_ns"][-1])
    now_ns = SECOND + 3 * PERIOD_NS
    due_ns = numbering.expected_arrival_ns(newest_ns - 4 * PERIOD_NS, now_ns)
    assert due_ns == SECOND - 4 * PERIOD_NS
    assert numbering.expected_arrival_ns(newest_ns + 10 * PERIOD_NS, now_ns) == now_ns
    assert numbering.expected_arrival_ns(newest_ns - 2 * SECOND, now_ns) == 0


def test_a_follower_without_a_name_is_judged_by_its_numbers():
    """By those that the silence allows, also where the one before it had a name."""
    numbering = SessionNumbering(PERIOD_NS)
    numbering.reconnect("a")
    numbering.number(made_frames(0, 10), SECOND)
    numbering.number(made_frames(10, 10), 100 * SECOND)
    numbering.reconnect()
    assert numbering.anew is False
    assert numbering.follower_time_ns == 0
    again = made_frames(20, 5)
    assert numbering.number(again, 100 * SECOND) == (again, 0)
    numbering.reconnect("")
    _, left_out = numbering.number(made_frames(9000, 5), 100 * SECOND + SECOND // 10)
    assert left_out == 100


@pytest.mark.parametrize("name", ["", "a"])
def test_the_time_that_passed_bounds_what_a_follower_may_have_counted(name):
    for beyond in (0, 1):
        numbering = SessionNumbering(PERIOD_NS)
        numbering.reconnect(name)
        numbering.number(made_frames(5, 100), SECOND)
        numbering.number(made_frames(105, 100), 9 * SECOND)
        numbering.reconnect(name)
        passed_s = 10 if name else 2  # of the same process since its first frame, else of silence
        most = largest_advance(passed_s * SECOND, shortest_period_ns(1000.0, 1.0))
        most -= numbering.frames if name else 0
        again = made_frames(204 + most + beyond, 5)
        _, left_out = numbering.number(again, 11 * SECOND)
        assert left_out == 2000 * beyond


@pytest.mark.parametrize("second", [None, 10, 0])
def test_a_jump_within_a_connection_is_a_gap_and_no_new_follower(second):
    numbering = SessionNumbering(PERIOD_NS)
    numbering.number(made_frames(0, 10), SECOND)
    if second is not None:  # the first number after the link was taken up again
        numbering.reconnect()
        numbering.number(made_frames(second, 10), SECOND + PERIOD_NS)
    taken, left_out = numbering.number(made_frames(90_000, 1), SECOND + 2 * PERIOD_NS)
    assert (left_out, taken["sequence"].tolist()) == (0, [90_000 + numbering.shift])


def test_where_no_time_passed_one_frame_is_missing_between_two_followers():
    numbering = SessionNumbering(PERIOD_NS)
    numbering.reconnect("a")
    numbering.number(made_frames(0, 10), SECOND)
    numbering.reconnect("b")
    taken, left_out = numbering.number(made_frames(0, 1), SECOND)
    assert (left_out, taken["sequence"][0]) == (1, 11)


@pytest.mark.parametrize(
    ("behind_ns", "shifted"), [(SECOND, False), (SECOND + 1, True), (5, False)]
)
def test_times_that_are_a_second_off_come_from_another_clock(behind_ns, shifted):
    numbering = SessionNumbering(PERIOD_NS)
    numbering.reconnect("a")
    first, again = made_frames(0, 10), made_frames(0, 1)
    first["time_ns"] += 90_000 * SECOND
    numbering.number(first, SECOND)
    numbering.reconnect("b")
    due_ns = int(first["time_ns"][-1]) + 21 * PERIOD_NS
    again["time_ns"] = due_ns - behind_ns
    taken, _ = numbering.number(again, SECOND + 20 * PERIOD_NS)
    assert taken["time_ns"][0] == (due_ns if shifted else due_ns - behind_ns)
    assert numbering.follower_time_ns == due_ns - behind_ns, "an echo is by its own clock"


@given(
    st.lists(
        st.tuples(st.booleans(), st.integers(0, 50), st.integers(1, 5), st.integers(0, 10**10)),
        min_size=1,
        max_size=20,
    )
)
def test_numbers_always_rise_whatever_connects(arrivals):
    numbering = SessionNumbering(PERIOD_NS)
    sequences = []
    raw, now_ns = 0, 0
    for anew, skipped, count, silence_ns in arrivals:
        now_ns += silence_ns
        if anew:
            numbering.reconnect()
            raw = 0
        raw += skipped
        taken, _ = numbering.number(made_frames(raw, count), now_ns)
        raw += count
        sequences += taken["sequence"].tolist()
    assert (np.diff(sequences) > 0).all()
    assert numbering.frames == sequences[-1] + 1 - sequences[0]


def wrapped(first, count, at):
    """Frames of a follower whose numbers begin at `at`, and wrap."""
    frames = made_frames(first, count)
    frames["sequence"] = (np.arange(first, first + count) + at) % SEQUENCES
    return frames


@example(2**31, [(3, 0)])
@example(2**31 - 1, [(3, 0)])
@given(
    st.integers(0, SEQUENCES - 1),
    st.lists(st.tuples(st.integers(1, 300), st.integers(0, 30)), min_size=1, max_size=8),
)
def test_the_numbers_of_a_session_rise_where_those_of_its_follower_wrap(at, blocks):
    numbering, first = SessionNumbering(PERIOD_NS), 0
    begun = at if at < 2**31 else 0
    for count, skipped in blocks:
        taken, left_out = numbering.number(wrapped(first, count, at), SECOND)
        assert left_out == 0
        assert taken["sequence"].tolist() == list(range(begun + first, begun + first + count))
        assert numbering.frames == first + count
        late = numbering.renumber(wrapped(0, 3, at))
        assert late["sequence"].tolist() == list(range(begun, begun + 3))
        first += count + skipped
        assert numbering.of_session((at + first) % SEQUENCES) == begun + first


def test_a_follower_goes_on_after_a_break_in_which_its_numbers_wrapped():
    numbering = SessionNumbering(PERIOD_NS)
    numbering.reconnect("a")
    numbering.number(wrapped(0, 100, SEQUENCES - 150), SECOND)
    numbering.reconnect("a")
    taken, left_out = numbering.number(wrapped(200, 5, SEQUENCES - 150), SECOND + 100 * PERIOD_NS)
    assert (left_out, taken["sequence"].tolist()) == (0, list(range(200, 205)))


@pytest.mark.parametrize("first", [0, 5099])
def test_a_follower_that_counts_anew_on_its_connection_is_put_behind_the_silence(first):
    numbering = SessionNumbering(PERIOD_NS)
    numbering.number(made_frames(5000, 100), SECOND)
    again = made_frames(first, 10)
    again["time_ns"] += (5350 - first) * PERIOD_NS
    taken, left_out = numbering.number(again, SECOND + 250 * PERIOD_NS)
    assert (left_out, taken["sequence"].tolist()) == (250, list(range(5350, 5360)))
    np.testing.assert_array_equal(taken["time_ns"], again["time_ns"])
    following, left_out = numbering.number(made_frames(first + 10, 2), SECOND + 260 * PERIOD_NS)
    assert (left_out, following["sequence"].tolist()) == (0, [5360, 5361])


def test_another_followers_clock_counts_even_if_its_numbers_go_on():
    numbering = SessionNumbering(PERIOD_NS)
    numbering.reconnect("one")
    numbering.number(made_frames(0, 100), 5 * SECOND)
    numbering.reconnect("another")
    again = made_frames(350, 10)  # as it happens, those that would be next
    again["time_ns"] -= 90 * SECOND  # another machine's clock
    taken, _ = numbering.number(again, 5 * SECOND + 250 * PERIOD_NS)
    assert taken["sequence"].tolist() == list(range(350, 360))
    assert np.all(np.diff([99 * PERIOD_NS, *taken["time_ns"].tolist()]) > 0)


class Watched:
    """A watch that is told of frames, and what it says."""

    def __init__(self):
        self.said = []
        self.watch = FrameRateWatch(1000.0, self.said.append)

    def stream(self, rate_hz, seconds, number=0, start_s=5.0):
        for count in range(round(rate_hz * seconds)):
            time_s = start_s + count / rate_hz
            self.watch.add(number + count, round(time_s * SECOND))


@pytest.mark.parametrize("rate_hz", [950.0, 1000.0, 1050.0])
def test_a_rate_within_five_percent_or_a_stall_that_is_made_up_is_nothing_to_say(rate_hz):
    watched = Watched()
    watched.stream(900.0, 1.0)
    watched.stream(1100.0, 1.0, 900, 6.0)
    watched.stream(rate_hz, 10.0, 2000, 7.0)
    assert watched.said == []
    assert watched.watch.fault is None


@pytest.mark.parametrize("rate_hz", [660.0, 940.0, 1060.0, 2000.0])
def test_another_rate_is_said_once_with_both_figures(rate_hz):
    watched = Watched()
    watched.stream(rate_hz, 1.9)
    assert watched.said == []
    watched.stream(rate_hz, 10.0, round(rate_hz * 1.9), 6.9)
    (sentence,) = watched.said
    assert "promised 1000 frames a second" in sentence
    assert f"sends {rate_hz:.0f}" in sentence
    assert watched.watch.fault == sentence
    watched.stream(1000.0, 4.0, round(rate_hz * 11.9), 16.9)
    assert watched.said[1:] == ["frames come at the 1000 Hz that the follower promised"]
    assert watched.watch.fault is None


def test_frames_that_are_lost_are_no_rate():
    watched = Watched()
    generator = np.random.default_rng(1)
    for number in range(30_000):
        late_ns = generator.integers(0, 20_000_000)
        if generator.random() < 0.7 and not 20_000 < number < 25_000:
            watched.watch.add(number, SECOND + number * 10**6 + int(late_ns))
    assert watched.said == []


def test_a_new_connection_and_a_clock_that_jumps_back_begin_anew():
    watched = Watched()
    watched.stream(1000.0, 3.0, 0, 500.0)
    watched.stream(1000.0, 3.0, 3000, 5.0)
    watched.stream(660.0, 1.5, 6000, 8.0)
    watched.watch.restart()
    watched.stream(660.0, 1.5, 0, 9.6)
    watched.watch.restart()
    watched.stream(1000.0, 5.0, 0, 99.0)
    assert watched.said == []
