"""The round trip of a command by its echo, and how long a silence is by round trips."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.core.frames import empty_frames
from mmt.follower.round_trips import EchoCheck, SilenceLimit
from mmt.scene import Link
from mmt.scene.files import scene_from_tables

MS = 1_000_000


def settled(limit, round_trips_ms):
    """The limit (ms) after commands of a second and more, one a millisecond."""
    for tick, round_trip_ms in enumerate(round_trips_ms):
        limit.add(round(round_trip_ms * MS), tick * MS)
    return limit.limit_ns / MS


@pytest.mark.parametrize(
    ("round_trip_ms", "keys", "limit_ms"),
    [(1, {}, 100), (40, {}, 100), (80, {}, 180), (500, {}, 250), (300, {"silence_ms": 50.0}, 50)],
)
def test_over_an_even_path_it_is_two_round_trips_and_a_margin_or_what_the_scene_sets(
    round_trip_ms, keys, limit_ms
):
    limit = SilenceLimit(Link(**keys))
    assert settled(limit, [round_trip_ms] * 4000) == pytest.approx(limit_ms, abs=1)


def test_it_follows_the_estimator_of_rfc_6298_one_sample_a_round_trip():
    limit = SilenceLimit(Link())
    limits_ms = [limit.limit_ns / MS]
    burst = [(72, 84)] * 500
    for round_trip_ms, arrival_ms in ((40, 0), (72, 39), (72, 40), (72, 83), *burst):
        limit.add(round_trip_ms * MS, arrival_ms * MS)
        limits_ms.append(limit.limit_ns / MS)
    # two of 40 ms and four of half of it; of 44 ms and 23 ms; and once of 47.5 ms and 24.25 ms
    assert limits_ms == [100, 160, 160, 180, 180, *[192] * 500]


@given(st.lists(st.integers(0, 2**62), min_size=1, max_size=50), st.floats(10, 10_000))
def test_it_never_leaves_its_bounds(round_trips_ns, longest_ms):
    limit = SilenceLimit(Link(silence_ms=10.0, longest_silence_ms=longest_ms))
    for number, round_trip_ns in enumerate(round_trips_ns):
        limit.add(round_trip_ns, number * 500 * MS)
        assert 10 * MS <= limit.limit_ns <= round(longest_ms * MS)


def test_a_longest_silence_below_the_usual_one_is_refused():
    link = {"silence_ms": 200.0, "longest_silence_ms": 150.0}
    with pytest.raises(InputError, match=r"longest_silence_ms is 150.*200"):
        scene_from_tables({"link": link})


def note(echoes, *times_ns):
    frames = empty_frames(len(times_ns), ["force"])
    frames["time_ns"] = times_ns
    echoes.note(frames)
    return echoes


@pytest.mark.parametrize("age_ns", [0, 1, 999_999, 10**12])
def test_a_round_trip_may_be_below_zero_by_what_two_clocks_differ(age_ns):
    assert EchoCheck().round_trip_ns(0, 0, 5 * MS) == 0
    echoes = note(note(EchoCheck(), 2 * MS, 3 * MS), 3 * MS)  # its clock stood still
    assert echoes.round_trip_ns(2 * MS, 0, 5 * MS) == 3 * MS
    assert echoes.round_trip_ns(0, 0, 5 * MS) == 3 * MS
    for round_trip_ns in (-MS - age_ns // 1000, 0, 50 * MS):
        arrival_ns = 3 * MS + age_ns + round_trip_ns
        assert echoes.round_trip_ns(3 * MS, age_ns, arrival_ns) == round_trip_ns
    assert echoes.round_trip_ns(3 * MS, age_ns, 2 * MS + age_ns - age_ns // 1000 - 1) is None


def test_the_newest_frames_are_known_and_no_more_than_twice_as_many(monkeypatch):
    monkeypatch.setattr("mmt.follower.round_trips._KEPT", 10)
    echoes, newest = EchoCheck(), 0
    for count in (*[1] * 50, 9, 11, 50):
        numbers = range(1, newest + count + 1)
        note(echoes, *[number * MS for number in numbers[newest:]])
        newest += count
        known = [n for n in numbers if echoes.round_trip_ns(n * MS, 0, newest * MS) is not None]
        assert known == list(numbers)[-len(known) :]
        assert min(newest, 10) <= len(known) <= 20
