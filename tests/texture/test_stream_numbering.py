"""Frames whose own numbers start anew or wrap are modelled, and not taken for late ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.arrays import RecordArray
from mmt.core.frames import SEQUENCES, empty_frames
from mmt.scene import Scene
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.online.history import build_model
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.numbering import StreamNumbering

SETTINGS = ModellingSettings(order=6)


def frames_of(first: int, count: int, time_ms: int = 0) -> RecordArray:
    frames = empty_frames(count)
    frames["sequence"] = (first + np.arange(count)) % SEQUENCES
    frames["time_ns"] = (time_ms + np.arange(count)) * 1_000_000
    return frames


@given(st.integers(0, SEQUENCES - 1), st.lists(st.integers(1, 400), min_size=1, max_size=8))
def test_numbers_go_on_where_they_wrap_whatever_the_parts(first: int, parts: list[int]) -> None:
    frames, numbering = frames_of(first, sum(parts)), StreamNumbering()
    pieces = np.split(frames, np.cumsum(parts)[:-1])
    numbers = np.concatenate([numbering.number(part)["sequence"] for part in pieces])
    np.testing.assert_array_equal(numbers.astype(np.int64), first + np.arange(len(frames)))


@given(st.integers(0, 5000), st.integers(0, 5000), st.booleans(), st.integers(1, 4000))
def test_a_sender_that_starts_anew_goes_on_behind_a_gap(
    first: int, again: int, own_clock: bool, part: int
) -> None:
    before = frames_of(first, 3000, time_ms=10)
    after = frames_of(again, 3000, time_ms=10 if own_clock else 3500)
    if again > first and (own_clock or again >= first + 3000):
        return  # a gap, or frames that came late: nothing tells that the sender is another
    frames, numbering = np.concatenate([before, after]), StreamNumbering()
    pieces = np.split(frames, range(part, len(frames), part))
    numbers = np.concatenate([numbering.number(one)["sequence"] for one in pieces]).astype(int)
    steps = np.diff(numbers)
    assert steps[2999] > 1000
    assert (np.delete(steps, 2999) == 1).all()
    assert numbers[3000] % 1000 == 0


def test_late_and_repeated_frames_keep_their_numbers() -> None:
    frames = frames_of(100, 2000)
    tangled = np.insert(frames, [1, 50, 1200, 1200], frames[[0, 49, 300, 1199]])
    assert StreamNumbering().number(tangled) is tangled
    assert len(StreamNumbering().number(frames[:0])) == 0


@pytest.fixture(scope="module")
def stroked() -> RecordArray:
    return simulate_session(Scene(), surface="wood", duration_s=6.0)[0]


def test_a_session_that_wraps_gives_the_same_model_to_the_bit(stroked: RecordArray) -> None:
    wrapped = stroked.copy()
    shift = (SEQUENCES - 3000) // 1000 * 1000
    wrapped["sequence"] = (stroked["sequence"].astype(np.int64) + shift) % SEQUENCES
    ours, other = (build_model(frames, SETTINGS).model_at(6.0) for frames in (stroked, wrapped))
    assert ours is not None
    assert other is not None
    for name in ("vertices", "kernel_parameters"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(other, name))


@pytest.mark.parametrize("same_clock", [True, False])
def test_two_sessions_in_one_give_the_segments_of_both(
    stroked: RecordArray, same_clock: bool
) -> None:
    again = stroked.copy()
    again["time_ns"] += 10_000_000_000 * same_clock
    one = build_model(stroked, SETTINGS).updates[-1]
    both = build_model(np.concatenate([stroked, again]), SETTINGS).updates[-1]
    assert one.model is not None
    assert both.model is not None
    assert len(both.model.samples) >= 2 * len(one.model.samples) - 2
    assert 13.0 <= both.time_s <= 14.0  # with the gap
