"""The streamed force: limited, faded in a silence, never stepping."""

import numpy as np
import pytest
from frame_samples import made_frames
from hypothesis import given
from hypothesis import strategies as st
from test_slew import Display

from mmt.leader.motion.feedback import StreamedForce


def forced(*force_n):
    frames = made_frames(0, 3)
    frames["force_n"][-1] = force_n
    return frames


def test_the_newest_force_is_displayed_within_the_limit_in_its_direction():
    handle = Display()
    force = StreamedForce(handle, limit_n=3.0)
    force.tick(1, None)
    assert force.summary == {"method": "streamed", "largest_n": 0.0}
    force.on_frames(forced(0.0, 0.0, 2.5))
    force.tick(1, None)
    force.on_frames(forced(30.0, 0.0, 40.0))
    force.tick(1, None)
    assert handle.forces[0] == (0.0, 0.0, 0.0)
    assert handle.forces[1] == (0.0, 0.0, 2.5)
    assert handle.forces[2] == pytest.approx((1.8, 0.0, 2.4))
    force.on_frames(forced(0.0, 0.0, 2.5))
    force.tick(1, None)
    assert force.summary["largest_n"] == 3.0


@given(st.lists(st.tuples(st.integers(1, 200), st.floats(0.0, 3.0)), min_size=1, max_size=12))
def test_a_force_that_comes_and_goes_never_steps(stretches):
    handle = Display()
    force = StreamedForce(handle, limit_n=3.0)
    for _ in range(60):  # as before a session: nothing has been heard yet
        force.tick(1, None)
    for silence_ticks, force_n in stretches:
        for _ in range(50 + silence_ticks):
            force.tick(1, None)
        for _ in range(1 + silence_ticks % 60):
            force.on_frames(forced(0.0, 0.0, force_n))
            force.tick(1, None)
    normal = np.array([z for _, _, z in handle.forces])
    assert np.abs(np.diff(normal)).max() <= 3.0 / 50 + 1e-12


def written(force, handle, ticks, *, stream):
    """Display once for each number of elapsed ticks; return the steps of the force written."""
    before = len(handle.forces)
    for elapsed in ticks:
        if stream:
            force.on_frames(forced(0.0, 0.0, 3.0))
        force.tick(elapsed, None)
    normal = [z for _, _, z in handle.forces[max(0, before - 1) :]]
    return np.abs(np.diff(normal))


@pytest.mark.parametrize("held_up", [2, 49, 75, 1000])
def test_a_held_up_tick_makes_no_step_of_the_force(held_up):
    """The ramps advance by what was written, out in a silence and in when frames come again."""
    handle = Display()
    force = StreamedForce(handle, limit_n=3.0, silence_ticks=40)
    written(force, handle, [1] * 3, stream=True)
    out = written(force, handle, [held_up, *[1] * 150], stream=False)
    assert out.max() == pytest.approx(3.0 / 40)
    assert handle.forces[-1] == (0.0, 0.0, 0.0)
    back = written(force, handle, [held_up, *[1] * 60], stream=True)
    assert back.max() == pytest.approx(3.0 / 40)
    assert handle.forces[-1] == (0.0, 0.0, 3.0)
