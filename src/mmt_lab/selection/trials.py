"""Simulated multi-trial data of known texture: segments at once, without a hand or a robot.

A session of 20 s takes over a second to simulate, and 20 seeds of 20 to 40 trials would take
half an hour. Here all strokes of all trials run side by side, tick by tick, through the same
resonators; what a stroke lacks are the corners between strokes, which segmentation cuts off.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.known_surfaces import KnownSurface
from mmt.testing.simulation.modes import maps_at
from mmt.testing.simulation.surfaces import HIGH_PASS_POLE, Surface
from mmt.texture.autoregression.burg import burg_batch
from mmt.texture.autoregression.forms import reflection_to_lsf
from mmt.texture.selection import ModelPoints
from mmt.texture.settings import MAXIMUM_FORCE_N, MAXIMUM_SPEED_MM_S
from mmt_lab.selection.knocks import add_knock, usual_knock

ORDER: Final = 12
NOISE_M_S2: Final = 0.03
"""Noise of the accelerometer (rms)."""

_SPEED_MM_S: Final = (20.0, 290.0)
_FORCE_N: Final = (0.2, 2.9)
_VARIATION: Final = (0.02, 0.12)  # std/mean of speed and force within a stroke
_LENGTH: Final = (200, 350)
_WARM_UP: Final = 200


@dataclass(frozen=True)
class Strokes:
    """Strokes of constant heading: ``speed_mm_s`` and ``force_n`` (t, n), ``heading_rad`` (n,).

    ``length`` (n,) is how many of the samples after the warm-up belong to each.
    """

    speed_mm_s: FloatArray
    force_n: FloatArray
    heading_rad: FloatArray
    length: FloatArray


@dataclass(frozen=True)
class Trials:
    """Fitted strokes with planted knocks.

    Attributes
    ----------
    data
        The points.
    without
        The same, none of them knocked on.
    knocked
        Which of `data` hold a knock, shape (n,).
    surface
        The truth.
    directed
        Whether the points have a heading.
    """

    data: ModelPoints
    without: ModelPoints
    knocked: BoolArray
    surface: KnownSurface
    directed: bool


def simulate_trials(
    surface: Surface,
    count: int,
    knocks: int,
    generator: np.random.Generator,
    *,
    directed: bool,
    recorded: Sequence[FloatArray] = (),
) -> Trials:
    """Return fitted strokes, some of them with a knock.

    Parameters
    ----------
    surface
        The texture.
    count, knocks
        Strokes, and how many of them hold a knock.
    generator
        Source of everything.
    directed
        Whether strokes have headings, and points three inputs.
    recorded
        Recorded knocks; where there are any, half of the planted ones are taken from them.
    """
    strokes = _strokes(count, generator, directed=directed)
    vibration = vibrate(surface, strokes, generator)
    vibration += NOISE_M_S2 * generator.standard_normal(vibration.shape)
    segments, places = [], np.empty((count, 2))
    for index in range(count):
        part = slice(_WARM_UP, _WARM_UP + int(strokes.length[index]))
        segments.append(vibration[part, index].copy())
        places[index] = strokes.speed_mm_s[part, index].mean(), strokes.force_n[part, index].mean()
    points = points_of(places[:, 0], places[:, 1], strokes.heading_rad, directed=directed)
    knocked = np.zeros(count, dtype=np.bool_)
    knocked[generator.choice(count, knocks, replace=False)] = True
    with_knocks = plant(segments, knocked, lambda: usual_knock(generator, recorded), generator)
    return Trials(fitted(points, with_knocks), fitted(points, segments), knocked, surface, directed)


def plant(
    segments: Sequence[FloatArray],
    knocked: BoolArray,
    knock: Callable[[], FloatArray],
    generator: np.random.Generator,
) -> list[FloatArray]:
    """Return segments of which those that are knocked on (n,) have a knock of their own."""
    return [
        add_knock(segment, knock(), generator) if hit else segment
        for segment, hit in zip(segments, knocked.tolist(), strict=True)
    ]


def fitted(points: FloatArray, segments: Sequence[FloatArray]) -> ModelPoints:
    """Return segments at normalised points (n, d), fitted at order `ORDER`."""
    fits = burg_batch(segments, ORDER)
    return ModelPoints(points, reflection_to_lsf(fits.reflection), fits.variances[:, -1], segments)


def points_of(
    speed_mm_s: FloatArray, force_n: FloatArray, heading_rad: FloatArray, *, directed: bool
) -> FloatArray:
    """Return normalised points (n, 2), or (n, 3) where the heading counts."""
    speed, force = speed_mm_s / MAXIMUM_SPEED_MM_S, force_n / MAXIMUM_FORCE_N
    if not directed:
        return np.column_stack([speed, force])
    return np.column_stack([speed * np.cos(heading_rad), speed * np.sin(heading_rad), force])


def _strokes(count: int, generator: np.random.Generator, *, directed: bool) -> Strokes:
    heading = generator.uniform(0.0, 2.0 * np.pi, count) if directed else np.zeros(count)
    return Strokes(
        generator.uniform(*_SPEED_MM_S, count) * _variation(count, generator),
        generator.uniform(*_FORCE_N, count) * _variation(count, generator),
        heading,
        generator.integers(*_LENGTH, count).astype(np.float64),
    )


def _variation(count: int, generator: np.random.Generator) -> FloatArray:
    """Return slow factors (t, n) of mean one, as a hand's speed and force have them."""
    time_s = np.arange(_WARM_UP + _LENGTH[1])[:, None] / RATE_HZ
    wave = np.zeros((len(time_s), count))
    for _ in range(3):
        frequency = generator.uniform(0.5, 4.0, count)
        phase = generator.uniform(0.0, 2.0 * np.pi, count)
        wave += np.cos(2.0 * np.pi * frequency * time_s + phase)
    wave -= wave[_WARM_UP:].mean(axis=0)
    wave /= wave[_WARM_UP:].std(axis=0)
    return np.maximum(1.0 + wave * generator.uniform(*_VARIATION, count), 0.3)


def vibrate(surface: Surface, strokes: Strokes, generator: np.random.Generator) -> FloatArray:
    """Return the vibration (t, n) along the normal, all strokes side by side.

    The resonators of `mmt.testing.simulation.vibration.Vibration`, for arrays.
    """
    ticks, count = strokes.speed_mm_s.shape
    cosine, sine = np.cos(strokes.heading_rad), np.sin(strokes.heading_rad)
    heard = np.zeros((ticks, count))
    for mode in surface.modes:
        parts = maps_at(mode, strokes.speed_mm_s, strokes.force_n, cosine, sine)
        power, frequency, bandwidth = (np.broadcast_to(part, heard.shape) for part in parts)
        radius = np.exp(-np.pi / RATE_HZ * bandwidth)
        turn = radius * np.exp(2j * np.pi / RATE_HZ * frequency)
        gain = np.sqrt(power * (1.0 - radius * radius))
        noise = generator.standard_normal((2, ticks, count))
        driven = gain * (noise[0] + 1j * noise[1])
        state = np.zeros(count, dtype=np.complex128)
        for tick in range(ticks):
            state = turn[tick] * state + driven[tick]
            heard[tick] += state.real
    passed = np.zeros((ticks, count))
    scale = 0.5 * (1.0 + HIGH_PASS_POLE)
    for tick in range(1, ticks):
        passed[tick] = HIGH_PASS_POLE * passed[tick - 1] + scale * (heard[tick] - heard[tick - 1])
    return passed
