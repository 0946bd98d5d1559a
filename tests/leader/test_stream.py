"""Vibration and motion as they are streamed, before there is a model."""

import numpy as np
import pytest
from frame_samples import made_frames

from mmt.core.arrays import RecordArray
from mmt.leader.output.playout import PlayoutBuffer
from mmt.leader.output.stream import StreamedMotion, StreamedVibration
from mmt.texture.settings import VibrationAxis


def vibrating(count: int) -> RecordArray:
    """A vibration of 100 Hz on gravity, along z; a slower one along x."""
    frames = made_frames(0, count, ("acceleration",))
    phase = 2 * np.pi * 0.1 * np.arange(count)
    frames["acceleration_m_s2"] = 0.0
    frames["acceleration_m_s2"][:, 2] = 9.81 + np.sin(phase)
    frames["acceleration_m_s2"][:, 0] = 5.0 * np.sin(phase / 2)
    return frames


def played(stream: StreamedVibration, buffer: PlayoutBuffer, frames: RecordArray) -> np.ndarray:
    output = []
    for frame in frames:
        now_ns = int(frame["time_ns"])
        stream.on_frames(np.atleast_1d(frame), now_ns)
        output.append(buffer.pull(now_ns))
    return np.array(output)


@pytest.mark.parametrize(("axis", "peak"), [("z", 1.0), ("x", 5.0), ("dft321", 1.0)])
def test_the_streamed_vibration_is_the_acceleration_without_gravity(
    axis: VibrationAxis, peak: float
) -> None:
    buffer = PlayoutBuffer(delay_ms=2.0)
    stream = StreamedVibration(buffer, axis, "z", 1000.0)
    output = played(stream, buffer, vibrating(1000))
    assert np.abs(output[:10]).max() < 1.2 * peak, "gravity must make no step"
    assert np.abs(output[500:]).max() == pytest.approx(peak, rel=0.05)
    assert abs(output[500:].mean()) < 0.05 * peak


def test_a_gap_in_the_stream_makes_no_click() -> None:
    buffer = PlayoutBuffer(delay_ms=2.0)
    stream = StreamedVibration(buffer, "z", "z", 1000.0)
    frames = vibrating(600)
    frames["acceleration_m_s2"][300:, 2] += 40.0  # unseen: the gap hides the step
    output = played(stream, buffer, frames[np.r_[0:250, 300:600]])
    assert np.abs(output).max() < 2.0


def moving(speed_mm_s: float, force_n: float, count: int) -> RecordArray:
    frames = made_frames(0, count)
    time_s = np.arange(count) / 1000
    frames["position_mm"] = 0.0
    frames["position_mm"][:, 0] = 0.6 * speed_mm_s * time_s
    frames["position_mm"][:, 1] = 0.8 * speed_mm_s * time_s
    frames["position_mm"][:, 2] = 50 * np.sin(time_s * 20)
    frames["force_n"] = (7.0, 7.0, force_n)
    return frames


@pytest.mark.parametrize("size", [1, 7, 400])
def test_speed_is_tangential_and_force_is_normal(size: int) -> None:
    motion = StreamedMotion("z", 1000.0)
    frames = moving(120.0, 1.5, 400)
    for first in range(0, 400, size):
        motion.on_frames(frames[first : first + size], 0)
    assert motion.speed_mm_s == pytest.approx(120.0, rel=1e-3)
    assert motion.force_n == pytest.approx(1.5, rel=1e-3)


@pytest.mark.parametrize(("normal", "expected"), [("z", (1.0, 0.0)), ("y", (1.0, 2.0))])
def test_the_velocity_is_that_along_the_axes_of_the_surface(
    normal: str, expected: tuple[float, float]
) -> None:
    frames = moving(0.0, 1.0, 400)
    for axis, slope in enumerate((1.0, 0.0, 2.0)):
        frames["position_mm"][:, axis] = 40.0 * slope * np.arange(400) / 1000.0
    motion = StreamedMotion(normal, 1000.0)  # type: ignore[arg-type]
    motion.on_frames(frames, 0)
    assert motion.velocity_mm_s == pytest.approx([40.0 * slope for slope in expected], abs=1e-3)


def test_pulling_is_no_normal_force_and_rest_is_zero() -> None:
    motion = StreamedMotion("z", 1000.0)
    motion.on_frames(moving(50.0, -2.0, 300), 0)
    assert motion.force_n == 0.0
    assert motion.speed_mm_s > 49.0
    motion.rest()
    assert (motion.speed_mm_s, motion.force_n) == (0.0, 0.0)


def test_a_gap_makes_no_jump_of_speed() -> None:
    motion = StreamedMotion("z", 1000.0)
    frames = moving(100.0, 1.0, 2000)
    motion.on_frames(frames[:500], 0)
    speeds = []
    for frame in frames[1500:]:
        motion.on_frames(np.atleast_1d(frame), 0)
        speeds.append(motion.speed_mm_s)
    assert max(speeds) < 110.0
    assert speeds[-1] == pytest.approx(100.0, rel=1e-3)
