"""Whatever a follower sends, neither force nor vibration jumps at the hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.devices.protocols import Vector
from mmt.leader.force_ramp import ForceRamp
from mmt.leader.slew import SlewLimitedDisplay, VibrationSlew
from mmt.scene.files import scene_from_tables

FORCES = st.tuples(*[st.floats(-40.0, 40.0)] * 3)


class Display:
    """Notes what is written."""

    def __init__(self) -> None:
        self.forces: list[Vector] = []

    def write(self, force_n: Vector) -> None:
        self.forces.append(force_n)


@given(st.lists(FORCES, min_size=1, max_size=30))
def test_a_force_changes_by_a_step_at_most(forces_n: list[Vector]) -> None:
    display = Display()
    limited = SlewLimitedDisplay(display, 0.5)
    for force_n in forces_n:
        limited.write(force_n)
    written = np.array([(0.0, 0.0, 0.0), *display.forces])
    assert np.linalg.norm(np.diff(written, axis=0), axis=1).max() <= 0.5 + 1e-9
    for _ in range(200):
        limited.write(forces_n[-1])
    assert display.forces[-1] == forces_n[-1]


def test_a_slow_force_passes_as_it_is_and_is_not_counted() -> None:
    display = Display()
    limited = SlewLimitedDisplay(display, 1.0)
    forces_n = [(0.0, 0.0, 0.9 * k) for k in range(4)]
    for force_n in forces_n:
        limited.write(force_n)
    assert display.forces == forces_n
    assert limited.limited_writes == 0
    limited.write((0.0, 0.0, -3.3))
    assert limited.limited_writes == 1


def test_a_vibration_changes_by_a_step_at_most_over_calls_too() -> None:
    slew = VibrationSlew(60.0)
    blocks = [np.array([60.0, -60.0]), np.array([60.0]), np.zeros(3)]
    for block in blocks:
        slew.limit(block)
    np.testing.assert_array_equal(np.concatenate(blocks), [60.0, 0.0, 60.0, 0.0, 0.0, 0.0])
    assert slew.limited_samples == 1
    texture = np.random.default_rng(1).normal(0.0, 7.0, 5000)
    same = texture.copy()
    slew.limit(same)
    np.testing.assert_array_equal(same, texture)


@given(
    st.lists(
        st.tuples(st.integers(1, 3000), st.booleans(), st.sampled_from([-3.0, 0.0, 3.0])),
        max_size=60,
    )
)
def test_a_held_up_tick_moves_the_force_by_one_step_of_the_ramp(
    ticks: list[tuple[int, bool, float]],
) -> None:
    """The remote force changes only where the source was away, as it does behind a stall."""
    ramp, force_n, shown = ForceRamp(), 2.0, [0.0]
    for _ in range(200):
        ramp.renew()
        shown.append(ramp.shape((0.0, 0.0, force_n), 1)[2])
    largest_step = (2 * 3.0 + 3.0) / 50 + 1e-9  # of the ramp between two forces, and of the fade
    for elapsed, fresh, other_n in ticks:
        if elapsed > 50:
            force_n = other_n
        if fresh:
            ramp.renew()
        shown.append(ramp.shape((0.0, 0.0, force_n), elapsed)[2])
    assert np.abs(np.diff(shown[1:])).max() <= largest_step


@pytest.mark.parametrize("slew", [1000.0, "off"])
def test_a_scene_states_the_slew_limits(slew: float | str) -> None:
    tables = {"link": {}, "hand": {}, "simulated": {}, "playout": {}}
    scene = scene_from_tables(
        {**tables, "force_feedback": {"slew_n_s": slew}, "actuator": {"slew_m_s3": slew}}
    )
    assert scene.force_feedback is not None
    assert scene.actuator is not None
    assert scene.force_feedback.slew_n_s == scene.actuator.slew_m_s3 == slew
