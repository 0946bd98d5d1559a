"""Vibration and motion as they are streamed, before there is a model."""

import math
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
from frame_samples import made_frames
from scipy import signal

import mmt
from mmt.leader.building import LeaderParts, playout
from mmt.leader.output.concealment import LONGEST_FRAMES
from mmt.leader.output.stream import PlayoutBuffer, StreamedVibration
from mmt.leader.output.synthesis import StreamedMotion
from mmt.leader.output.three_axes import ThreeAxes
from mmt.leader.parts import PARTS
from mmt.scene import Link
from mmt.testing.simulation.surfaces.textures import get_surface

LIMIT_MM_S = Link().limit_mm_s


def vibrating(count):
    """A vibration of 100 Hz on gravity, along z; a slower one along x."""
    frames = made_frames(0, count, ("acceleration",))
    phase = 2 * np.pi * 0.1 * np.arange(count)
    frames["acceleration_m_s2"] = 0.0
    frames["acceleration_m_s2"][:, 2] = 9.81 + np.sin(phase)
    frames["acceleration_m_s2"][:, 0] = 5.0 * np.sin(phase / 2)
    return frames


def played(stream, buffer, frames):
    output = []
    for frame in frames:
        now_ns = int(frame["time_ns"])
        stream.on_frames(np.atleast_1d(frame), now_ns)
        output.extend(buffer.pull(now_ns))
    return np.array(output)


@pytest.mark.parametrize(("axis", "peak"), [("z", 1.0), ("x", 5.0), ("dft321", 26.0**0.5)])
def test_the_streamed_vibration_is_the_acceleration_without_gravity(axis, peak):
    buffer = PlayoutBuffer(delay_ms=2.0)
    stream = StreamedVibration(buffer, axis, 1000.0)
    output = played(stream, buffer, vibrating(1000))
    assert np.abs(output[:10]).max() < 1.2 * peak, "gravity must make no step"
    assert output[500:].std() * 2.0**0.5 == pytest.approx(peak, rel=0.05)
    assert abs(output[500:].mean()) < 0.05 * peak


WITH_A_HAND = {"link": {}, "simulated": {}, "hand": {}, "actuator": {}}


def test_the_part_is_what_the_scene_says_and_tells_its_delay():
    tables = {
        "playout": {"delay_ms": 7.0, "longest_delay_ms": 50.0, "conceal": "repetition"},
        "texture": {"axis": "y"},
    }
    scene = mmt.Scene.model_validate(WITH_A_HAND | tables)
    remote = SimpleNamespace(clock_offset_ns=2_000_000)
    session = SimpleNamespace(
        scene=scene, period_ns=500_000, samples_per_frame=2, rate_hz=2000.0, remote=remote
    )
    part = playout(session, LeaderParts())
    frames = made_frames(0, 400, ("acceleration",), samples_per_frame=2)
    frames["acceleration_m_s2"] = 0.0
    frames["acceleration_m_s2"][..., 1] = 3.0 * (-1.0) ** np.arange(800).reshape(400, 2)
    frames["time_ns"] = np.arange(400) * 500_000
    output = played(part, part.buffer, frames)
    assert len(output) == 800
    assert np.abs(output[-100:]).mean() == pytest.approx(3.0, rel=0.02)
    assert np.flatnonzero(output)[0] // 2 == 14, "7 ms at 2 kHz"
    assert part.status() == {"playout_delay_ms": 7.0}
    counts = asdict(part.buffer.statistics())
    told = part.summary(0.2)["vibration"]["playout"]
    assert told == counts | {"age_ms": part.buffer.age_ms(2_000_000)}
    assert told["age_ms"] != part.buffer.age_ms(None)
    session.remote = None
    assert part.summary(0.2)["vibration"]["playout"]["age_ms"] == part.buffer.age_ms(None)
    (gauge,) = part.metrics()
    assert (gauge.name, gauge.documentation) == (
        "mmt_playout_delay_seconds",
        "Delay of the playout buffer.",
    )
    assert [sample.value for sample in gauge.samples] == [0.007]


@pytest.mark.parametrize(
    "tables", [{"recording": {}}, {"rendering": {"before": "silent"}, "texture": {}}]
)
def test_a_scene_that_streams_nothing_has_no_playout(tables):
    assert not PARTS["playout"].wanted(mmt.Scene.model_validate(WITH_A_HAND | tables))


def coloured(rng, centre_hz, count):
    low, high = 0.6 * centre_hz, min(1.6 * centre_hz, 480.0)
    band = signal.butter(2, (low, high), "bandpass", fs=1000.0, output="sos")
    return signal.sosfilt(band, rng.normal(0.0, 3.0, count))


@pytest.mark.parametrize(
    "kind", ["one direction", "independent", "equal", "turning", "strokes", "one axis"]
)
def test_three_axes_give_a_channel_of_their_power_and_spectrum(kind):
    """The oracle is Parseval's: the powers of the three axes, and their Welch spectra, summed."""
    rng, count = np.random.default_rng(2), 40_000
    first, second, third = (coloured(rng, centre, count) for centre in (80.0, 160.0, 300.0))
    equal = np.column_stack([coloured(rng, 150.0, count) for _ in range(3)])
    sense = np.sign(np.sin(2.0 * np.pi * np.arange(count) / 700.0))
    loudness = np.abs(np.sin(np.pi * np.arange(count) / 400.0))[:, None]
    axes = {
        "one direction": np.outer(second, (0.5, -0.4, 0.8)),
        "independent": np.column_stack([first, 0.5 * second, 0.2 * third]),
        "equal": equal,
        "turning": np.column_stack([second * sense, 0.0 * second, 0.7 * second]),
        "strokes": np.column_stack([first, 0.6 * second, third]) * loudness,
        "one axis": np.column_stack([first, 0.0 * first, 0.0 * first]),
    }[kind]
    together = ThreeAxes(1000.0)
    played = np.array([together.steps((x,), (y,), (z,))[0] for x, y, z in axes.tolist()])[1000:]
    axes = axes[1000:]
    level_db = 10.0 * np.log10(np.mean(played**2) / np.mean(np.sum(axes**2, axis=1)))
    assert abs(level_db) < 0.1
    density = signal.welch(played, 1000.0, nperseg=256)[1]
    wanted = sum(signal.welch(axes[:, axis], 1000.0, nperseg=256)[1] for axis in range(3))
    strong = wanted > 0.01 * wanted.max()
    assert np.sqrt(np.mean((10.0 * np.log10(density[strong] / wanted[strong])) ** 2)) < 0.5


@pytest.mark.parametrize("axis", ["z", "dft321"])
@pytest.mark.parametrize("name", ["wood", "plastic", "ribbed"])
def test_the_stream_and_the_truth_as_the_model_are_of_one_level(name, axis):
    """Stroke by stroke the expected power is the truth's, integrated over frequency."""
    surface = get_surface(name)
    frames, _ = mmt.simulate_session(mmt.Scene(), surface=name, duration_s=20.0)
    buffer = PlayoutBuffer(delay_ms=2.0)
    output = played(StreamedVibration(buffer, axis, 1000.0), buffer, frames)
    motion = StreamedMotion("z", 1000.0, LIMIT_MM_S)
    moved = []
    for frame in frames:
        motion.on_frames(np.atleast_1d(frame), 0)
        moved.append((math.hypot(*motion.velocity_mm_s), motion.force_n))
    speed, force = np.array(moved)[::20].T
    grid = np.arange(0.0, 500.5, 1.0)
    density = surface.spectrum(speed, force, grid)
    share = 1.0 if axis == "z" else 1.0 + surface.tangential_share**2
    wanted = share * np.trapezoid(density[:, 10:], grid[10:], axis=1)
    strokes = wanted > 0.05 * wanted.max()
    power = (output**2)[: 20 * len(wanted)].reshape(-1, 20).mean(axis=1)[: len(wanted)]
    step_db = 10.0 * np.log10(power[strokes].mean() / wanted[strokes].mean())
    assert abs(step_db) < 0.5


@pytest.mark.parametrize("peak", [0.1, 1.0, 5.0])
def test_a_gap_in_the_stream_makes_no_click(peak):
    buffer = PlayoutBuffer(delay_ms=2.0)
    stream = StreamedVibration(buffer, "z", 1000.0)
    frames = vibrating(600)
    frames["acceleration_m_s2"][:, 2] = 9.81 + peak * (frames["acceleration_m_s2"][:, 2] - 9.81)
    frames["acceleration_m_s2"][300:, 2] += 8.0 * peak  # unseen: the gap hides the step
    output = played(stream, buffer, frames[np.r_[0:250, 300:600]])
    assert np.abs(output).max() < 2.0 * peak


@pytest.mark.parametrize(
    ("missing", "restarts"), [(LONGEST_FRAMES, False), (LONGEST_FRAMES + 1, True)]
)
def test_the_filter_restarts_after_a_gap_that_cannot_be_concealed(missing, restarts):
    vibration = []
    buffer = SimpleNamespace(push=lambda *frame: vibration.append(frame[-1]))
    frames = np.delete(vibrating(600), range(303, 303 + missing))
    StreamedVibration(buffer, "z", 1000.0).on_frames(frames, 0)
    assert (vibration[303] == [0.0]) == restarts, "a filter starts in the steady state"


def moving(speed_mm_s, force_n, count):
    frames = made_frames(0, count)
    time_s = np.arange(count) / 1000
    frames["position_mm"] = 0.0
    frames["position_mm"][:, 0] = 0.6 * speed_mm_s * time_s
    frames["position_mm"][:, 1] = 0.8 * speed_mm_s * time_s
    frames["position_mm"][:, 2] = 50 * np.sin(time_s * 20)
    frames["force_n"] = (7.0, 7.0, force_n)
    return frames


@pytest.mark.parametrize("size", [1, 7, 400])
def test_speed_is_tangential_and_force_is_normal(size):
    motion = StreamedMotion("z", 1000.0, LIMIT_MM_S)
    frames = moving(120.0, 1.5, 400)
    for first in range(0, 400, size):
        motion.on_frames(frames[first : first + size], 0)
    assert math.hypot(*motion.velocity_mm_s) == pytest.approx(120.0, rel=1e-3)
    assert motion.force_n == pytest.approx(1.5, rel=1e-3)


@pytest.mark.parametrize(("normal", "expected"), [("z", (1.0, 0.0)), ("y", (1.0, 2.0))])
def test_the_velocity_is_that_along_the_axes_of_the_surface(normal, expected):
    frames = moving(0.0, 1.0, 400)
    for axis, slope in enumerate((1.0, 0.0, 2.0)):
        frames["position_mm"][:, axis] = 40.0 * slope * np.arange(400) / 1000.0
    motion = StreamedMotion(normal, 1000.0, LIMIT_MM_S)
    motion.on_frames(frames, 0)
    assert motion.velocity_mm_s == pytest.approx([40.0 * slope for slope in expected], abs=1e-3)


def test_pulling_is_no_normal_force_and_rest_is_zero():
    motion = StreamedMotion("z", 1000.0, LIMIT_MM_S)
    motion.on_frames(moving(50.0, -2.0, 300), 0)
    assert motion.force_n == 0.0
    assert math.hypot(*motion.velocity_mm_s) > 49.0
    motion.on_lost()
    assert (math.hypot(*motion.velocity_mm_s), motion.force_n) == (0.0, 0.0)


@pytest.mark.parametrize(("missing", "jump_mm", "slowest"), [(5, 0, 99), (1, 30, 0), (1000, 0, 0)])
def test_a_gap_makes_no_jump_of_speed(missing, jump_mm, slowest):
    motion = StreamedMotion("z", 1000.0, LIMIT_MM_S)
    frames = moving(100.0, 1.0, 2000)
    frames["position_mm"][500:] += jump_mm
    motion.on_frames(frames[:500], 0)
    speeds = []
    for frame in frames[500 + missing :]:
        motion.on_frames(np.atleast_1d(frame), 0)
        speeds.append(math.hypot(*motion.velocity_mm_s))
    assert slowest <= min(speeds) <= max(speeds) < 110.0
    assert speeds[-1] == pytest.approx(100.0, rel=1e-3)
