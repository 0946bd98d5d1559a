"""A session's frames are numbered on, whichever follower connects."""

import numpy as np
from frame_samples import PERIOD_NS, made_frames
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.leader.numbering import SessionNumbering

SECOND = 1_000_000_000


def test_the_frames_of_one_follower_pass_as_they_are() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    for first in (7, 10, 40):  # with a gap
        frames = made_frames(first, 3)
        taken, left_out = numbering.number(frames, first)
        assert taken is frames
        assert left_out == 0
    assert numbering.frames == 43 - 7


def test_a_follower_that_takes_its_link_up_again_goes_on_counting() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    numbering.number(made_frames(0, 100), 1)
    numbering.reconnect()
    again = made_frames(300, 5)
    assert numbering.number(again, 2) == (again, 0)
    assert numbering.frames == 305


def test_a_follower_that_is_started_anew_is_put_behind_the_silence() -> None:
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
    assert left_out == 0
    assert following["sequence"].tolist() == [360, 361]


def test_a_follower_that_counts_from_far_ahead_is_put_behind_the_silence_too() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    numbering.number(made_frames(0, 100), 5 * SECOND)
    numbering.reconnect()
    taken, left_out = numbering.number(made_frames(2**31 - 20, 10), 5 * SECOND + 250 * PERIOD_NS)
    assert left_out == 250
    assert taken["sequence"].tolist() == list(range(350, 360))
    assert numbering.frames == 360


def test_another_process_is_told_by_its_name_whatever_it_counts() -> None:
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


def test_a_leader_that_was_paused_knows_the_follower_that_went_on() -> None:
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


def test_a_follower_anew_that_counts_on_is_not_taken_for_the_one_before() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    numbering.reconnect("a")
    numbering.number(made_frames(0, 100), SECOND)
    numbering.reconnect("b")
    taken, left_out = numbering.number(made_frames(100, 5), SECOND + 10 * PERIOD_NS)
    assert left_out == 10
    assert taken["sequence"].tolist() == list(range(110, 115))


def test_another_clock_is_put_right_but_echoed_as_it_is() -> None:
    numbering = SessionNumbering(PERIOD_NS)
    first = made_frames(0, 100)
    first["time_ns"] += 90_000 * SECOND
    numbering.number(first, SECOND)
    numbering.reconnect()
    again = made_frames(0, 10)
    taken, left_out = numbering.number(again, SECOND + 20 * PERIOD_NS)
    assert left_out == 20
    assert taken["time_ns"][0] - first["time_ns"][-1] == 21 * PERIOD_NS
    assert (np.diff(taken["time_ns"]) == PERIOD_NS).all()
    assert numbering.follower_time_ns == again["time_ns"][-1]


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.booleans(), st.integers(0, 50), st.integers(1, 5), st.integers(0, 10**10)),
        min_size=1,
        max_size=20,
    )
)
def test_numbers_always_rise_whatever_connects(
    arrivals: list[tuple[bool, int, int, int]],
) -> None:
    numbering = SessionNumbering(PERIOD_NS)
    sequences: list[int] = []
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
