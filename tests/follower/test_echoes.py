"""Only an echo of a frame that was sent gives a command's age, and nearly the true one."""

import pytest

from mmt.core.frames import empty_frames
from mmt.follower.echoes import EchoCheck

MS = 1_000_000


def note(echoes: EchoCheck, *times_ns: int) -> EchoCheck:
    frames = empty_frames(len(times_ns), ["force"])
    frames["time_ns"] = times_ns
    echoes.note(frames)
    return echoes


@pytest.mark.parametrize("age_ns", [0, 1, 999_999, 10**12])
def test_a_round_trip_may_be_below_zero_by_what_two_clocks_differ(age_ns: int) -> None:
    assert EchoCheck().round_trip_ns(0, 0, 5 * MS) == 0
    echoes = note(note(EchoCheck(), 2 * MS, 3 * MS), 3 * MS)  # its clock stood still
    assert echoes.round_trip_ns(2 * MS, 0, 5 * MS) == 3 * MS
    assert echoes.round_trip_ns(0, 0, 5 * MS) == 3 * MS
    for round_trip_ns in (-MS - age_ns // 1000, 0, 50 * MS):
        arrival_ns = 3 * MS + age_ns + round_trip_ns
        assert echoes.round_trip_ns(3 * MS, age_ns, arrival_ns) == round_trip_ns
    assert echoes.round_trip_ns(3 * MS, age_ns, 2 * MS + age_ns - age_ns // 1000 - 1) is None


def test_the_newest_frames_are_known_and_no_more_than_twice_as_many(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("mmt.follower.echoes._KEPT", 10)
    echoes, newest = EchoCheck(), 0
    for count in (*[1] * 50, 9, 11, 50):
        numbers = range(1, newest + count + 1)
        note(echoes, *[number * MS for number in numbers[newest:]])
        newest += count
        known = [n for n in numbers if echoes.round_trip_ns(n * MS, 0, newest * MS) is not None]
        assert known == list(numbers)[-len(known) :]
        assert min(newest, 10) <= len(known) <= 20
