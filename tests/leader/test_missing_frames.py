"""Missing frames are noted, asked for, taken once, and given up in bounded time."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.frames import frame_dtype
from mmt.leader import backfill
from mmt.leader.backfill import MissingFrames


def numbered(*numbers):
    frames = np.zeros(len(numbers), frame_dtype())
    frames["sequence"] = numbers
    return frames


class Account:
    """An account with what it asks and notes."""

    def __init__(self, most=1000, keeps=1000):
        self.asked = []
        self.notes = []
        self.missing = MissingFrames(most, self.asked.append, self._note)
        self.missing.connect(keeps)

    def _note(self, sentence, *, announce, **details):
        self.notes.append({"sentence": sentence, "announce": announce, **details})

    def wait(self, ticks):
        """Return in how many of the ticks frames had come or been given up."""
        return sum(self.missing.tick(1) for _ in range(ticks))


def test_a_gap_is_noted_before_it_is_asked_for_and_closed_when_it_is_filled():
    account = Account()
    account.missing.jumped(9, numbered(12, 13, 15))
    assert (account.asked, account.notes) == ([], [])
    assert account.wait(50) == 0
    assert account.asked == [[(10, 12), (14, 15)]]
    (note,) = account.notes
    assert (note["kind"], note["frames"], note["announce"]) == ("gap", 3, False)
    assert note["ranges"] == [(10, 12), (14, 15)]
    taken = account.missing.take_missing(numbered(14, 11, 10, 9, 12, 14))  # not all is missing
    assert taken["sequence"].tolist() == [10, 11, 14]
    assert account.wait(150) == 1
    assert account.notes[1]["sentence"] == "of the missing frames 3 are filled in"
    assert account.notes[1]["ranges"] == [(10, 12), (14, 15)]
    assert account.missing.first is None
    counts = {"missing": 3, "filled": 3, "lost": 0, "waiting": 0, "unwanted": 3}
    assert account.missing.summary == counts


def test_long_gaps_are_announced_and_what_the_follower_has_not_got_is_lost():
    account = Account(most=300, keeps=200)
    account.missing.add_gap(0, 1000)
    account.wait(50)
    assert account.asked == [[(800, 1000)]]
    account.missing.give_up([(900, 2000)])
    account.missing.take_missing(numbered(*range(800, 900)))
    account.wait(50)
    assert [note["announce"] for note in account.notes] == [True, True]
    assert account.notes[1]["sentence"] == ("of the missing frames 100 are filled in, 900 are lost")
    assert account.missing.first is None


def test_of_a_follower_that_keeps_nothing_nothing_is_asked():
    account = Account(keeps=0)
    account.missing.add_gap(3, 5)
    account.wait(100)
    assert account.asked == []
    assert account.notes[-1]["sentence"] == "of the missing frames 2 are lost"


def test_an_answer_that_does_not_come_is_asked_for_again_and_then_given_up():
    account = Account()
    account.missing.add_gap(3, 5)
    account.wait(1500)
    assert account.asked == [[(3, 5)]] * 2
    account.missing.take_missing(numbered(3))  # it does answer, only slowly
    account.wait(2000)
    assert account.asked == [[(3, 5)]] * 2 + [[(4, 5)]] * 2
    account.missing.connect(1000)  # after a reconnection it is asked for anew
    account.wait(50)
    assert account.asked == [[(3, 5)]] * 2 + [[(4, 5)]] * 3
    account.wait(3050)
    assert account.missing.first is None
    assert account.missing.summary["lost"] == 1


def test_a_lost_answer_is_asked_for_again_while_others_come():
    account = Account()
    account.missing.add_gap(0, 1)
    for number in range(10, 2000, 20):  # each of these gaps is filled at once
        account.missing.add_gap(number, number + 1)
        account.wait(50)
        account.missing.take_missing(numbered(number))
    asked = [at for at, ranges in enumerate(account.asked) if (0, 1) in ranges]
    assert asked == [0, 20, 40, 60, 80]
    assert account.missing.first == 0


def test_a_follower_that_still_has_the_frames_is_waited_for():
    account = Account(most=30_000, keeps=10_000)
    account.missing.add_gap(3, 5)
    account.wait(9900)
    assert account.asked == [[(3, 5)]] * 10
    assert account.missing.take_missing(numbered(3))["sequence"].tolist() == [3]
    account.wait(10_100)
    assert account.missing.summary["filled"] == account.missing.summary["lost"] == 1


def test_at_the_end_what_still_waits_is_noted_as_lost():
    account = Account()
    for number in (3, 4, 5):
        account.missing.add_gap(number, number + 1)
    assert account.missing.outstanding() == [(3, 6)]
    account.missing.close()
    assert [note["kind"] for note in account.notes] == ["gap", "filled"]
    assert account.notes[-1]["lost"] == 3
    account.missing.close()
    assert len(account.notes) == 2


def test_a_bad_link_cannot_fill_the_memory_and_what_it_brings_late_is_taken():
    account = Account(most=10**6, keeps=9000)
    numbers = numbered(*range(0, 20_000, 2))
    account.missing.jumped(-1, numbers)
    account.wait(50)
    assert len(account.asked[0]) == backfill.MOST_RANGES
    assert account.missing.summary["lost"] == 10_000 - 1 - backfill.MOST_RANGES
    account.missing.connect(9000)  # which asks again for all, some at a time
    account.wait(50 * 46)
    assert [len(ranges) for ranges in account.asked[1:]] == [backfill.MOST_RANGES] * 46
    account.missing.give_up([(0, 1599)])
    taken = account.missing.take_missing(numbered(*range(20_000)))
    assert taken["sequence"].tolist() == list(range(19_999 - 2 * (9000 + 200), 19_999, 2))
    account.wait(50)
    assert account.notes[-2]["sentence"] == "9000 frames that were given up have come"
    assert account.missing.summary["lost"] == sum(n.get("lost", 0) for n in account.notes) == 799


@settings(max_examples=150)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("live"), st.integers(0, 30), st.integers(1, 4)),
            st.tuples(st.just("late"), st.integers(0, 120), st.integers(1, 30)),
            st.tuples(st.just("gone"), st.integers(0, 120), st.integers(1, 30)),
            st.tuples(st.just("tick"), st.integers(1, 1200), st.just(0)),
        ),
        max_size=40,
    )
)
def test_every_number_is_live_filled_lost_or_waited_for(happenings):
    account = Account(most=50, keeps=40)
    newest, live, filled = 0, 1, set[int]()
    for kind, first, count in happenings:
        if kind == "live":
            frames = numbered(*range(newest + 1 + first, newest + 1 + first + count))
            account.missing.jumped(newest, frames)
            newest, live = newest + first + count, live + count
        elif kind == "late":
            taken = account.missing.take_missing(numbered(*range(first, first + count)))["sequence"]
            assert filled.isdisjoint(taken.tolist()), "no frame is taken twice"
            filled |= set(taken.tolist())
        elif kind == "gone":
            account.missing.give_up([(first, first + count)])
        else:
            account.missing.tick(first)
        summary = account.missing.summary
        assert summary["filled"] == len(filled)
        assert summary["missing"] == summary["filled"] + summary["lost"] + summary["waiting"]
        assert newest + 1 == live + summary["missing"]
    account.missing.close()
    gaps = [note for note in account.notes if note["kind"] == "gap"]
    closed = [note for note in account.notes if note["kind"] == "filled"]
    summary = account.missing.summary
    assert sum(note["frames"] for note in gaps) == summary["missing"]
    assert sum(note["frames"] for note in closed) == summary["missing"]
    assert sum(note["lost"] for note in closed) == summary["lost"]


def test_frames_that_no_follower_sent_are_counted_as_missing_and_lost():
    account = Account()
    account.missing.jumped(9, numbered(12))
    account.missing.give_up_all()
    account.missing.add_unsent(4338)
    assert not len(account.missing.take_missing(numbered(10, 11)))
    assert account.missing.summary["missing"] == account.missing.summary["lost"] == 4340
    account.wait(200)
    assert account.asked == []
