"""Vibration of a known surface under a hand whose motion and force change, sample by sample."""

from abc import ABC, abstractmethod
from math import cos, exp, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from mmt.testing.simulation import NoiseRows
from mmt.testing.simulation.surfaces.modes import maps_at
from mmt.testing.simulation.surfaces.surface import Surface


class Stroke(NamedTuple):
    """What the tip does on the surface."""

    speed_mm_s: float
    force_n: float
    heading: tuple[float, float] = (1.0, 0.0)
    """Unit vector of its velocity in the plane."""
    position_mm: tuple[float, float] = (0.0, 0.0)
    """Its place in the plane."""


class VibrationSource(ABC):
    """Makes the vibration of a surface at the surface's rate."""

    @property
    def friction_coefficient(self) -> float | None:
        """Friction of the surface that a course has reached, or None without a course."""
        return None

    @abstractmethod
    def run(self, count: int, stroke: Stroke) -> list[tuple[float, float]]:
        """Return the next samples of a stroke that stays the same meanwhile.

        Returns
        -------
        samples
            The acceleration (m/s2) along the normal and along the heading, `count` times.
        """

    def step(self, stroke: Stroke) -> tuple[float, float]:
        """Return the next sample; see `run`."""
        return self.run(1, stroke)[0]


class SurfaceVibration(VibrationSource):
    """A causal generator whose stationary spectrum is exactly `Surface.spectrum`.

    Each mode is a pair of numbers. At every sample the pair rotates, shrinks by a factor below 1
    and is fed two white noises; one number of the pair is the output. Frequency, bandwidth and
    gain follow speed, force and heading. However they change, the generator is stable: apart from
    the noise added, a state only shrinks, which a filter in direct form does not guarantee. Cost:
    about 0.6 us a mode and call of `run`, 0.4 us a mode and sample.

    Parameters
    ----------
    surface
        The texture.
    generator
        Source of every random number; nothing else draws from it.
    """

    def __init__(self, surface: Surface, generator: np.random.Generator) -> None:
        self._share = surface.tangential_share
        self._width, self._angle = pi / surface.rate_hz, 2.0 * pi / surface.rate_hz
        self._pole = surface.high_pass_pole
        # a part without a grain ignores the heading: one call less, four times a tick
        self._modes = [(mode, mode.maps if mode.grain is None else None) for mode in surface.modes]
        self._states = [(0.0, 0.0, 0.0, 0.0) for _ in surface.modes]
        self._noise = NoiseRows(generator, 4 * len(surface.modes))
        self._sums = (0.0, 0.0)
        self._passed = (0.0, 0.0)

    def run(self, count: int, stroke: Stroke) -> list[tuple[float, float]]:
        """Return the next samples; see `VibrationSource.run`."""
        speed_mm_s, force_n, (cosine, sine), _ = stroke
        turns: list[tuple[float, float, float]] = []
        for mode, maps in self._modes:
            power, frequency, bandwidth = (
                maps(speed_mm_s, force_n)
                if maps is not None
                else maps_at(mode, speed_mm_s, force_n, cosine, sine)
            )
            radius = exp(-self._width * bandwidth)
            c = radius * cos(self._angle * frequency)
            s = radius * sin(self._angle * frequency)
            turns.append((c, s, sqrt(power * (1.0 - radius * radius))))
        return [self._advance(turns) for _ in range(count)]

    def _advance(self, turns: list[tuple[float, float, float]]) -> tuple[float, float]:
        """Rotate each mode's pairs by cosine and sine, and feed them noise times the gain."""
        noise = self._noise.next()
        normal = along = 0.0
        for index, (c, s, gain) in enumerate(turns):
            x, y, u, v = self._states[index]
            place = 4 * index
            output = c * x - s * y + gain * noise[place]
            other = c * u - s * v + gain * noise[place + 2]
            self._states[index] = (
                output,
                s * x + c * y + gain * noise[place + 1],
                other,
                s * u + c * v + gain * noise[place + 3],
            )
            normal += output
            along += other
        return self._high_pass(normal, along)

    def _high_pass(self, normal: float, along: float) -> tuple[float, float]:
        pole = self._pole
        scale = 0.5 * (1.0 + pole)
        before_normal, before_along = self._sums
        passed_normal = pole * self._passed[0] + scale * (normal - before_normal)
        passed_along = pole * self._passed[1] + scale * (along - before_along)
        self._sums = (normal, along)
        self._passed = (passed_normal, passed_along)
        return passed_normal, self._share * passed_along
