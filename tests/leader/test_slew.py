"""Whatever a follower sends, neither force nor vibration jumps at the hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.guards import ForceRamp, GuardedDisplay, VibrationSlew
from mmt.scene.files import scene_from_tables

FORCES = st.tuples(*[st.floats(-40.0, 40.0)] * 3)
FORCE_N = (1.0, 2.0, -4.0)


class Display:
    """Notes what is written."""

    def __init__(self):
        self.forces = []

    def write(self, force_n):
        self.forces.append(force_n)


@given(st.lists(FORCES, min_size=1, max_size=30))
def test_a_force_changes_by_a_step_at_most(forces_n):
    display = Display()
    limited = GuardedDisplay(display, 100.0, 0.5)
    for force_n in forces_n:
        limited.write(force_n)
    written = np.array([(0.0, 0.0, 0.0), *display.forces])
    assert np.linalg.norm(np.diff(written, axis=0), axis=1).max() <= 0.5 + 1e-9
    for _ in range(200):
        limited.write(forces_n[-1])
    assert display.forces[-1] == forces_n[-1]


def test_a_slow_force_passes_as_it_is_and_is_not_counted():
    display = Display()
    limited = GuardedDisplay(display, 100.0, 1.0)
    forces_n = [(0.0, 0.0, 0.9 * k) for k in range(4)]
    for force_n in forces_n:
        limited.write(force_n)
    assert display.forces == forces_n
    assert limited.limited_writes == 0
    for writes in (1, 2):
        limited.write((0.0, 0.0, -3.3))
        assert limited.limited_writes == writes


def test_a_vibration_changes_by_a_step_at_most_over_calls_too():
    slew = VibrationSlew(500.0, 60.0)
    blocks = [np.array([-60.0, 0.0, 60.0, -60.0]), np.array([60.0]), np.zeros(3)]
    for block in blocks:
        slew.limit(block)
    np.testing.assert_array_equal(
        np.concatenate(blocks), [-60.0, 0.0, 60.0, 0.0, 60.0, 0.0, 0.0, 0.0]
    )
    assert slew.limited_samples == 1
    block = np.array([200.0, 200.0])
    slew.limit(block)
    np.testing.assert_array_equal(block, [60.0, 120.0])
    assert slew.limited_samples == 3
    slew.limit(np.array([60.0, 0.0]))
    texture = np.random.default_rng(1).normal(0.0, 7.0, 5000)
    same = texture.copy()
    slew.limit(same)
    np.testing.assert_array_equal(same, texture)


@pytest.mark.parametrize("keys", [{}, {"samples_per_tick": 3}])
@given(wanted=st.floats(1e3, 1e300))
def test_vibration_beyond_the_limit_fades_over_its_whole_time(wanted, keys):
    slew, samples = VibrationSlew(60.0, **keys), keys.get("samples_per_tick", 1)
    played = []
    for silent in (False, True, False):
        block = np.full(15 * samples, wanted)
        slew.limit(block, silent=silent)
        played += block.tolist()
    fading = [max(60.0 - 6.0 * k / samples, 0.0) for k in range(1, 15 * samples + 1)]
    whole = [60.0] * len(fading)
    assert played == pytest.approx(whole + fading + [60.0 - each for each in fading])
    block = np.array([math.nan])
    slew.limit(block)
    assert block == pytest.approx(60.0 - 6.0 / samples)


def shares(ramp, ticks, force_n=FORCE_N, elapsed=1):
    """Shape a force in each tick and return which share of it is displayed on all axes."""
    found = []
    for _ in range(ticks):
        shown = ramp.shape(force_n, elapsed)
        assert shown == pytest.approx(tuple(shown[0] / force_n[0] * each for each in force_n))
        found.append(shown[0] / force_n[0])
    return found


def test_the_force_goes_out_after_a_silence_and_in_over_the_ramp():
    ramp = ForceRamp(silence_ticks=2, ramp_ticks=4)
    for _ in range(2):
        assert shares(ramp, 7) == [1.0, 1.0, 0.75, 0.5, 0.25, 0.0, 0.0]
        assert ramp.silent
        ramp.renew()
        assert not ramp.silent
        assert shares(ramp, 1) == [0.25]
        for share in (0.5, 0.75, 1.0, 1.0):
            ramp.renew()
            assert shares(ramp, 1) == [share]
        ramp.renew()


def test_it_comes_in_from_what_is_displayed_on_each_axis():
    ramp = ForceRamp(silence_ticks=2, ramp_ticks=4)
    shares(ramp, 4)  # half of it is left
    ramp.renew()
    shown = ramp.shape((9.0, 8.0, 7.0), 1)
    assert shown == pytest.approx((0.75 * 0.5 + 9 / 4, 0.75 * 1.0 + 2.0, -0.75 * 2.0 + 7 / 4))


def test_missed_ticks_count_for_the_silence_alone():
    ramp = ForceRamp(silence_ticks=2, ramp_ticks=4)
    assert shares(ramp, 3, elapsed=50) == [0.75, 0.5, 0.25]


def test_a_source_that_has_left_is_silent_at_once():
    ramp = ForceRamp(silence_ticks=2, ramp_ticks=4)
    ramp.fall_silent()
    assert ramp.silent
    assert shares(ramp, 5) == [0.75, 0.5, 0.25, 0.0, 0.0]


def test_after_a_rest_the_force_returns_from_zero():
    ramp = ForceRamp(silence_ticks=2, ramp_ticks=4)
    shares(ramp, 1)
    ramp.pause(1)
    assert not ramp.silent
    ramp.renew()
    assert shares(ramp, 1) == [0.25]
    ramp.renew()
    ramp.pause(1)
    ramp.pause(2)
    assert ramp.silent
    ramp.renew()
    assert shares(ramp, 2) == [0.25, 0.5]


@pytest.mark.parametrize("slew", [1000.0, "off"])
def test_a_scene_states_the_slew_limits(slew):
    tables = {"link": {}, "hand": {}, "simulated": {}, "playout": {}}
    scene = scene_from_tables(
        {**tables, "force_feedback": {"slew_n_s": slew}, "actuator": {"slew_m_s3": slew}}
    )
    assert scene.force_feedback.slew_n_s == scene.actuator.slew_m_s3 == slew
