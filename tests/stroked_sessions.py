"""Sessions that are made stroke by stroke, so that their segments are known beforehand."""

from pathlib import Path

import numpy as np
import pytest

from mmt.core.frames import empty_frames
from mmt.session.data import RecordedSession

STROKE_SAMPLES = 250
LIFT_SAMPLES = 100
POLES = 0.9 * np.exp(2j * np.pi * np.array([0.08, -0.08]))

Stroke = tuple[float, float]


def resonant_noise(count, generator):
    """Return AR(2) noise with a resonance at 80 Hz and unit power."""
    b, c = float(POLES.sum().real), float(np.prod(POLES).real)
    power = (1 + c) / ((1 - c) * ((1 + c) ** 2 - b**2))
    noise = generator.standard_normal(count + 200) / np.sqrt(power)
    values = np.zeros(count + 200)
    for n in range(2, count + 200):
        values[n] = b * values[n - 1] - c * values[n - 2] + noise[n]
    return values[200:]


def strokes_over_plane():
    """Return (mm/s, N) of strokes that cover the plane twice, in a scattered order."""
    grid = [(speed, force) for speed in (50, 150, 250) for force in (0.5, 1.5, 2.5)]
    order = np.random.default_rng(7).permutation(len(grid))
    once = [grid[index] for index in order]
    return once + [(1.08 * speed, 0.93 * force) for speed, force in once] + once


def stroked_frames(strokes, level=1.0, seed=0):
    """Return frames of straight strokes of constant speed and force, lifted in between."""
    speed_mm_s = []
    force_n = []
    for speed, force in strokes:
        speed_mm_s += [np.full(STROKE_SAMPLES, speed), np.zeros(LIFT_SAMPLES)]
        force_n += [np.full(STROKE_SAMPLES, force), np.zeros(LIFT_SAMPLES)]
    speed_all, force_all = np.concatenate(speed_mm_s), np.concatenate(force_n)
    frames = empty_frames(len(speed_all))
    frames["sequence"] = np.arange(len(frames))
    frames["time_ns"] = np.arange(len(frames)) * 1_000_000
    frames["position_mm"][:, 0] = np.cumsum(speed_all) / 1000
    frames["force_n"][:, 2] = force_all
    vibration = level * resonant_noise(len(frames), np.random.default_rng(seed))
    frames["acceleration_m_s2"][:, 2] = 9.81 + np.where(force_all > 0, vibration, 0.0)
    return frames


@pytest.fixture(scope="session")
def stroked_session():
    """Return a session of 27 strokes on a texture that is the same at all speeds and forces."""
    return RecordedSession(stroked_frames(strokes_over_plane()), path=Path("even.mcap"))


@pytest.fixture(scope="session")
def make_session():
    """Return a maker of sessions from strokes."""

    def make(strokes, **options):
        return RecordedSession(stroked_frames(strokes, **options), path=Path("made.mcap"))

    return make
