"""Frames whose own numbers start anew or wrap are modelled, and not taken for late ones."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.frames import empty_frames
from mmt.core.sequence_numbers import SEQUENCES
from mmt.texture.signals.filtering import StreamNumbering


def frames_of(first, count, time_ms=0):
    frames = empty_frames(count)
    frames["sequence"] = (first + np.arange(count)) % SEQUENCES
    frames["time_ns"] = (time_ms + np.arange(count)) * 1_000_000
    return frames


@given(st.integers(0, SEQUENCES - 1), st.lists(st.integers(1, 400), min_size=1, max_size=8))
def test_numbers_go_on_where_they_wrap_whatever_the_parts(first, parts):
    frames, numbering = frames_of(first, sum(parts)), StreamNumbering()
    pieces = np.split(frames, np.cumsum(parts)[:-1])
    numbers = np.concatenate([numbering.number(part)["sequence"] for part in pieces])
    np.testing.assert_array_equal(numbers.astype(np.int64), first + np.arange(len(frames)))


@given(st.integers(0, 5000), st.integers(0, 5000), st.booleans(), st.integers(1, 4000))
def test_a_sender_that_starts_anew_goes_on_behind_a_gap(first, again, own_clock, part):
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


def test_late_and_repeated_frames_keep_their_numbers():
    frames = frames_of(100, 2000)
    tangled = np.insert(frames, [1, 50, 1200, 1200], frames[[0, 49, 300, 1199]])
    assert StreamNumbering().number(tangled) is tangled
    assert len(StreamNumbering().number(frames[:0])) == 0
