"""Acceleration that is no measurement: held, saturated, constant; and silence, which is one."""

from functools import cache

import numpy as np
import pytest
import scipy.signal
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from stream_samples import judged, stroke_frames
from stroked_sessions import resonant_noise, stroked_frames

from mmt.scene import Hand, Link, Scene, Simulated, Texture
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import SignalFaults
from mmt.texture.signals.filtering import StreamFilter


def texture(count, seed, amplitude=1.0):
    """Return an autoregressive vibration with random resonances, rms 1 times an amplitude."""
    generator = np.random.default_rng(seed)
    radii, angles = generator.uniform(0.3, 0.97, 3), generator.uniform(0.15, 3.0, 3)
    poles = np.concatenate([radii * np.exp(1j * angles), radii * np.exp(-1j * angles)])
    excitation = generator.standard_normal(count + 500)
    excitation[500:] *= amplitude
    x = scipy.signal.lfilter([1.0], np.real(np.poly(poles)), excitation)
    return np.asarray(x[500:] / x[:500].std())


@pytest.mark.parametrize("noise", [0.0, 0.06])
@pytest.mark.parametrize("step", [0.0, 0.002, 0.02])
def test_a_held_value_is_found_and_nothing_else(noise, step):
    """One in thirty may be missed: a value that lies where the vibration rests may be silence."""
    found = []
    for seed in range(30):
        random = np.random.default_rng(seed)
        length = int(random.integers(30, 600))
        x = texture(6000, seed) + noise * random.standard_normal(6000)
        x = step * np.round(x / step) if step else x
        away = np.abs(x[3000:5000]) > 0.5
        away &= np.abs(np.diff(x[2999:5000])) > 0.1
        start = 3000 + int(random.choice(np.flatnonzero(away)))
        x[start : start + length] = x[start]
        aligned, faults = judged(stroke_frames(x))
        held = slice(start + 1, start + length)
        found.append(not (aligned.measured[held] | aligned.valid[held]).any())
        assert faults.held_s <= (length + 3) / 1000
        assert aligned.valid[start + length + 80 :].all()
        assert faults.saturated_s == faults.constant_s == 0
    assert np.mean(found) > 0.95


@given(seed=st.integers(0, 10_000), length=st.integers(150, 600))
@settings(max_examples=40)
def test_a_vibration_that_decays_is_silence_and_a_value_held_beside_it_is_not(seed, length):
    """As above, the held value follows no step as small as those of a vibration that rings out."""
    amplitude = np.ones(12_000)
    for start in range(2000, 12_000, 2000):
        amplitude[start : start + length] = 0.0
    x = texture(12_000, seed, amplitude)
    aligned, faults = judged(stroke_frames(x))
    assert faults == SignalFaults()
    assert aligned.measured.all()
    away = (np.abs(x[5000:5600]) > 0.5) & (np.abs(np.diff(x[4999:5600])) > 0.1)
    start = 5000 + int(np.random.default_rng(seed).choice(np.flatnonzero(away)))
    x[start : start + 300] = x[start]
    aligned, faults = judged(stroke_frames(x))
    inside = np.zeros(len(aligned), np.bool_)
    inside[start : start + 300] = True
    np.testing.assert_array_equal(aligned.measured, ~inside)


@pytest.mark.parametrize("silent_value", [0.0, 0.4])
def test_silence_into_which_a_vibration_sinks_within_some_samples_is_measured(silent_value):
    place = np.arange(12_000) % 2000
    envelope = np.sqrt((np.abs(place - 1750.0) / 250.0 - 0.8).clip(0.0, 0.2) * 5.0)
    silent = envelope == 0.0
    held = []
    for seed in range(40):
        x = texture(12_000, seed) * envelope + silent_value
        held.append(np.count_nonzero(~judged(stroke_frames(x))[0].measured[silent[:-11]]))
    assert np.mean(held) < 0.1 * np.count_nonzero(silent)
    assert np.median(held) == 0


def test_a_vibration_that_stops_at_once_at_its_mean_is_mostly_held():
    found = []
    for seed in range(40):
        x = texture(6000, seed)
        x[4000:4300] = 0.0
        found.append(1000 * judged(stroke_frames(x))[1].held_s > 290)
    assert np.mean(found) > 0.6


def test_a_coarse_converter_at_rest_is_not_held():
    held = []
    amplitude = np.where((np.arange(9000) // 1000) % 2 == 1, 1.0, 0.0)
    for seed in range(60):
        generator = np.random.default_rng(seed)
        step, offset = generator.uniform(0.05, 0.3), generator.uniform(0.0, 1.0)
        noise = 0.03 * generator.standard_normal(9000)
        x = texture(9000, seed, amplitude) + noise + offset * step
        _, faults = judged(stroke_frames(step * np.round(x / step)))
        held.append(round(1000 * faults.held_s))
        assert faults.saturated_s == faults.constant_s == 0
    assert np.median(held) <= 20
    assert np.mean(held) < 0.01 * len(amplitude)


@pytest.mark.parametrize("repeats", [2, 4, 8])
def test_a_slow_sensor_that_repeats_its_values_is_used_once_that_is_known(repeats):
    x = np.repeat(texture(8000 // repeats, 3), repeats)
    aligned, faults = judged(stroke_frames(x))
    assert aligned.measured[200:].all()
    assert faults.saturated_s == 0


def clipped(seed, limit, sides, step):
    """Return which samples of a clipped texture are at a rail, and what was found of them."""
    x = texture(12_000, seed)
    low, high = -np.inf if sides == "upper" else -limit, np.inf if sides == "lower" else limit
    x = x.clip(low, high)
    frames = stroke_frames(step * np.round(x / step) if step else x)
    value = frames["acceleration_m_s2"][:, 2]
    at_rail = (value == value.max()) & np.isfinite(high)
    at_rail |= (value == value.min()) & np.isfinite(low)
    aligned, faults = judged(frames)
    return at_rail[: len(aligned)], aligned, faults


SIDES = ["both", "upper", "lower"]


@given(
    seed=st.integers(0, 10_000),
    limit=st.floats(0.3, 1.5),
    sides=st.sampled_from(SIDES),
    step=st.sampled_from([0.0, 0.005]),
)
@settings(max_examples=40)
def test_samples_at_the_rail_are_found(seed, limit, sides, step):
    at_rail, aligned, faults = clipped(seed, limit, sides, step)
    assert not aligned.valid[4000:][at_rail[4000:]].any()
    assert aligned.measured[4000:][~at_rail[4000:]].mean() > 0.98
    assert faults.saturated_s > 0.5 * np.count_nonzero(at_rail) / 1000


@given(seed=st.integers(0, 10_000), step=st.sampled_from([0.0, 0.005, 0.05]))
@settings(max_examples=40)
def test_a_vibration_within_the_range_has_no_rail(seed, step):
    x = texture(12_000, seed)
    _, faults = judged(stroke_frames(step * np.round(x / step) if step else x))
    assert faults.saturated_s == faults.constant_s == 0
    assert faults.held_s <= 0.024  # at the crest of a slow wave that a coarse converter reads


def test_a_rail_that_a_sample_exceeds_was_none():
    x = texture(8000, 1)
    x[3000:3500] = x[3000:3500].clip(-0.8, 0.8)
    aligned, faults = judged(stroke_frames(x))
    assert faults.saturated_s > 0.05
    assert aligned.measured[3600:].all()


def test_one_axis_that_changes_is_a_measurement_of_three():
    frames = stroke_frames(texture(1000, 1))
    stream = StreamFilter(ModellingSettings(axis="dft321"))
    aligned = stream.process(frames)
    assert aligned.measured.all()
    assert StreamFilter(ModellingSettings(axis="x")).process(frames).measured.sum() == 0


def test_what_is_unplugged_is_held_and_the_vibration_goes_on_behind_it():
    x = texture(8000, 5)
    frames = stroke_frames(x)
    frames["acceleration_m_s2"][3000:5000] = 0.0
    aligned, faults = judged(frames)
    np.testing.assert_array_equal(np.flatnonzero(~aligned.measured), np.arange(3000, 5000))
    assert faults.held_s == 2.0
    assert aligned.valid[5000:].all()
    whole, _ = judged(stroke_frames(x))
    error = aligned.vibration_m_s2[5000:] - whole.vibration_m_s2[5000:]
    assert np.sqrt(np.mean(error**2)) < 0.05


def test_a_channel_that_is_not_finite_is_counted():
    frames = stroke_frames(texture(1000, 1))
    frames["acceleration_m_s2"][:, 2] = np.nan
    aligned, faults = judged(frames)
    assert len(aligned) == 0
    assert faults == SignalFaults(not_finite_s=1.0)
    frames = stroke_frames(texture(1000, 1))
    frames["acceleration_m_s2"][500:503, 2] = np.nan
    _, faults = judged(np.delete(frames, 600))
    assert faults == SignalFaults(not_finite_s=0.003, missing_s=0.001, bridged_s=0.004)


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

    One in twenty may be missed, as above.
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
