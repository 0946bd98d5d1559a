"""Frames are requested in the follower's numbers, and given on in those of the session."""

import numpy as np
import pytest
from frame_samples import PERIOD_NS, made_frames
from hypothesis import assume, given
from hypothesis import strategies as st

from mmt.core.sequence_numbers import SEQUENCES
from mmt.leader.backfill import Backfill
from mmt.leader.numbering import SessionNumbering
from mmt.link.protocol import FollowerHello

HELLO = FollowerHello(("force",), "test", keep_frames=1000)
ARRIVAL_NS = 10**9
FIRSTS = st.sampled_from([0, 5, 2**31 + 7, SEQUENCES - 20])


class Filled:
    """A session of which `gap` frames are missing after the first 15."""

    def __init__(self, first, gap):
        self.calls = []
        self.requested = []
        self.numbering = SessionNumbering(PERIOD_NS)
        self.backfill = Backfill(
            1000, self.numbering, lambda *call: self.calls.append(call), self.requested.extend,
            lambda *_, **__: None,
        )  # fmt: skip
        assert self.backfill.settled is False
        self.gap = range(first + 15, first + 15 + gap)
        self.numbering.reconnect("one")
        self.backfill.connect(HELLO)
        assert self.backfill.missing_ranges(9) == []
        assert self.backfill.summary == {}
        self.backfill.connect(HELLO)
        self.begin = int(
            self.numbering.number(self.frames(first, 15), ARRIVAL_NS)[0]["sequence"][0]
        )
        self.live = self.numbering.number(self.frames(self.gap.stop, 3), ARRIVAL_NS)[0]
        self.backfill.missing.jumped(self.begin + 14, self.live)

    @staticmethod
    def frames(first, count):
        frames = made_frames(first, count)
        frames["time_ns"] = np.arange(first, first + count) * PERIOD_NS
        return frames


def numbers(ranges):
    assert all(0 <= first < stop <= SEQUENCES for first, stop in ranges)
    return [number for first, stop in ranges for number in range(first, stop)]


@given(FIRSTS, st.integers(1, 40), st.data())
def test_what_comes_again_is_given_on_once_with_its_time(first, gap, data):
    session = Filled(first, gap)
    session.backfill.tick(50)
    assert numbers(session.requested) == [number % SEQUENCES for number in session.gap]
    order = data.draw(st.permutations(range(gap)))
    for _ in range(2):
        session.backfill.receive(session.frames(session.gap.start, gap)[order])
    ((verb, frames, arrival_ns),) = session.calls
    assert verb == "on_backfill"
    assert frames["sequence"].tolist() == list(range(session.begin + 15, session.begin + 15 + gap))
    assert arrival_ns == ARRIVAL_NS - (gap + 2) * PERIOD_NS
    session.backfill.tick(49)
    assert len(session.calls) == 1
    session.backfill.tick(1)
    assert session.calls[1:] == [("on_settled",)]
    assert session.backfill.summary["filled"] == session.backfill.summary["unwanted"] == gap


@pytest.mark.parametrize("way", ["gone", "all gone", "another follower", "restart", "close"])
@given(FIRSTS, st.integers(1, 40))
def test_what_cannot_come_is_given_up_and_told(way, first, gap):
    session, skipped = Filled(first, gap), 0
    if way == "gone":
        session.backfill.tick(50)
        session.backfill.give_up(session.requested)
    elif way == "all gone":
        assume(first < SEQUENCES - 20)  # its numbers do not wrap
        session.backfill.give_up([(0, SEQUENCES)])
    elif way == "another follower":
        session.numbering.reconnect("two")
        session.backfill.connect(HELLO)
    elif way == "restart":
        session.backfill.restart(skipped := 7)
    else:
        session.backfill.close()
    assert session.backfill.summary["missing"] == session.backfill.summary["lost"] == gap + skipped
    assert session.calls == [("on_settled",)]


@given(FIRSTS, st.integers(1, 40), st.integers(-5, 30))
def test_at_the_end_all_that_is_missing_is_listed(first, gap, tail):
    session = Filled(first, gap)
    stop = session.gap.stop + 3
    wanted = [*session.gap, *range(stop, stop + tail)]
    for _ in range(2):
        listed = session.backfill.missing_ranges((stop + tail) % SEQUENCES)
        assert numbers(listed) == [number % SEQUENCES for number in wanted]
        assert session.backfill.settled
        assert session.backfill.summary["missing"] == len(wanted)
    assert session.numbering.frames == stop + max(tail, 0) - first
    session.backfill.connect(HELLO)
    assert session.backfill.settled is False
