"""Frames that wait for an update come out in order, whatever order they came in."""

import numpy as np
from frame_samples import made_frames
from hypothesis import given
from hypothesis import strategies as st

from mmt.leader.modelling.segmenting import FrameQueue


@given(st.lists(st.integers(0, 60), unique=True, max_size=60), st.integers(1, 20), st.data())
def test_however_frames_come_the_queue_gives_them_out_in_order_and_once(numbers, period, data):
    in_time = data.draw(st.sets(st.sampled_from(numbers))) if numbers else set()
    queue = FrameQueue(100, least_drop=1)
    for number in sorted(in_time):
        assert queue.put(made_frames(number, 1)) == 0
    inserted = set(in_time)
    for number in numbers:
        if number not in in_time:
            assert queue.insert(made_frames(number, 1)) == 0
            inserted.add(number)
            assert queue.first_sequence == min(inserted)
    given_out = []
    while (frames := queue.pop_period(period, None)) is not None:
        taken = frames["sequence"].astype(np.int64)
        assert taken[-1] - taken[0] >= period - 1
        assert len(taken) == 1 or taken[-2] - taken[0] < period - 1
        given_out += taken.tolist()
    given_out += queue.pop_all()["sequence"].tolist() if numbers else []
    assert given_out == sorted(numbers)
    assert len(queue) == 0


@given(st.lists(st.integers(0, 60), unique=True, min_size=1, max_size=60), st.integers(1, 10))
def test_a_full_queue_drops_its_oldest_frames_and_keeps_its_order(numbers, capacity):
    queue = FrameQueue(capacity, least_drop=1)
    dropped = sum(queue.insert(made_frames(number, 1)) for number in numbers)
    first = queue.first_sequence
    taken = queue.pop_all()["sequence"].tolist()
    assert taken == sorted(taken)
    assert first == taken[0]
    assert (len(taken), dropped) == (min(capacity, len(numbers)), max(0, len(numbers) - capacity))
