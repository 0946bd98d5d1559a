"""At rest and in the air nothing is held: a value that is repeated is a fault in a stroke alone."""

from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from stream_samples import judged
from stroked_sessions import resonant_noise, stroked_frames, strokes_over_plane

from mmt.scene import Hand, Link, Scene, Simulated, Texture
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.signals.aligned import SignalFaults

HANDS = ["strokes", "quick", "circles", "taps", "scratching", "pauses"]
REST, STROKE = 400, 600


@cache
def moved(hand, seed):
    """Return 10 s of a simulated hand without any sensor's noise."""
    scene = Scene(
        link=Link(), texture=Texture(), simulated=Simulated(noise=False), hand=Hand(kind=hand)
    )
    return simulate_session(scene, "plastic", 10.0, seed)[0]


def strokes_and_rests(count, seed, gravity):
    """Return strokes to and fro with rests between them, in which nothing vibrates."""
    phase = np.arange(count * (REST + STROKE)) % (REST + STROKE)
    stroking = phase >= REST
    turn = np.where(np.arange(len(phase)) // (REST + STROKE) % 2, -1.0, 1.0)
    frames = stroked_frames([(50.0, 1.0)] * (len(phase) // 350 + 1))[: len(phase)].copy()
    frames["position_mm"][:, 0] = 0.1 * np.cumsum(turn * stroking)
    frames["force_n"][:, 2] = 1.0
    vibration = resonant_noise(len(phase), np.random.default_rng(seed))
    frames["acceleration_m_s2"][:, 2] = gravity + np.where(stroking, vibration, 0.0)
    return frames


def speed_mm_s(frames):
    position_mm = frames["position_mm"][:, :2].astype(np.float64)
    return np.hypot(*np.gradient(position_mm, 1e-3, axis=0).T)


@pytest.mark.parametrize("hand", HANDS)
@given(
    seed=st.integers(0, 10_000),
    level=st.floats(1e-3, 1e2),
    gravity=st.sampled_from([0.0, 9.81]),
    silent_mm_s=st.floats(0.1, 10.0),
)
@settings(max_examples=15)
def test_a_session_without_noise_has_no_fault_whatever_the_hand(
    hand, seed, level, gravity, silent_mm_s
):
    """The vibration grows with speed, and is nothing where the tool does not stroke."""
    frames = moved(hand, seed % 2).copy()
    speed = speed_mm_s(frames)
    sounding = (frames["force_n"][:, 2] > 0.0) & (speed > silent_mm_s)
    amplitude = np.where(sounding, level * speed / 100.0, 0.0)
    vibration = amplitude * resonant_noise(len(frames), np.random.default_rng(seed))
    frames["acceleration_m_s2"][:, 2] = gravity + vibration
    aligned, faults = judged(frames)
    assert faults == SignalFaults()
    first = np.flatnonzero(frames["acceleration_m_s2"][:, 2] != np.float32(gravity))[0]
    assert aligned.measured[first:].all()


@pytest.mark.parametrize("level", [1e-3, 1.0, 1e3])
def test_strokes_between_rests_that_are_cut_to_nothing_lose_no_sample(level):
    frames = stroked_frames(strokes_over_plane(), level)
    aligned, faults = judged(frames)
    assert faults == SignalFaults()
    assert aligned.valid[100:].all()


@given(
    seed=st.integers(0, 10_000),
    gravity=st.sampled_from([0.0, 9.81]),
    start=st.integers(0, REST - 50),
    away=st.floats(0.3, 20.0),
)
@settings(max_examples=40)
def test_what_sticks_at_rest_is_held_from_the_stroke_on(seed, gravity, start, away):
    frames = strokes_and_rests(10, seed, gravity)
    first = 7 * (REST + STROKE)
    stuck = slice(first + start, first + REST + 300)
    # of repeats behind steps so small that there were hardly any, nothing has been learnt
    assume(abs(frames["acceleration_m_s2"][stuck.start - 1, 2] - gravity - away) > 0.1)
    frames["acceleration_m_s2"][stuck, 2] = gravity + away
    aligned, _ = judged(frames)
    late = slice(first + REST + 1, first + REST + 300)
    assert not aligned.measured[late].any()
    assert aligned.measured[: first + REST - 15].all()
    assert aligned.measured[stuck.stop :].all()


def test_what_sticks_in_a_stroke_is_held_until_it_changes():
    """At rest too: a sensor that is known to be stuck is so until it gives another value.

    One in twenty may be missed, as in `test_validity`.
    """
    found = []
    for seed in range(40):
        frames = strokes_and_rests(7, seed, 9.81)
        acceleration = frames["acceleration_m_s2"][:, 2]
        begin, end = 5 * (REST + STROKE) + REST + 50, 6 * (REST + STROKE)
        away = np.abs(acceleration[begin : end - 50] - 9.81) > 0.5
        away &= np.abs(np.diff(acceleration[begin - 1 : end - 50])) > 0.1
        start, stop = begin + int(np.flatnonzero(away)[5 * seed]), end + 200
        acceleration[start:stop] = acceleration[start]
        aligned, _ = judged(frames)
        found.append(not aligned.measured[start + 1 : stop].any())
        assert aligned.measured[:start].all()
        assert aligned.measured[stop:].all()
    assert np.mean(found) >= 0.95


def test_what_is_unplugged_again_and_again_is_held_each_time():
    frames = strokes_and_rests(10, 1, 9.81)
    unplugged = np.zeros(len(frames), np.bool_)
    for number in range(5, 9):
        start = number * (REST + STROKE) + REST + 100
        unplugged[start : start + 300] = True
    frames["acceleration_m_s2"][unplugged] = 0.0
    aligned, _ = judged(frames)
    np.testing.assert_array_equal(aligned.measured, ~unplugged[: len(aligned)])


def test_one_value_throughout_is_no_measurement_from_the_first_stroke_on():
    frames = strokes_and_rests(3, 1, 0.0)
    frames["acceleration_m_s2"][:, 2] = 9.81
    aligned, _ = judged(frames)
    assert not aligned.measured[REST + 15 :].any()
    assert aligned.measured[: REST - 15].all()
    still, faults = judged(frames[: REST - 1])
    assert faults == SignalFaults()
    assert still.measured.all()


def test_a_gap_in_which_the_tool_went_elsewhere_is_no_stroke():
    frames = strokes_and_rests(6, 1, 9.81)
    rest = 5 * (REST + STROKE)
    frames["position_mm"][rest + 200 :, 0] += 20.0
    frames = np.delete(frames, slice(rest + 150, rest + 200))
    aligned, _ = judged(frames)
    assert aligned.measured.all()
