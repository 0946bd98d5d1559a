"""Vibration of a known surface under a hand whose motion and force change, tick by tick."""

from math import cos, exp, floor, pi, sin, sqrt
from typing import Protocol

import numpy as np

from mmt.testing.simulation import PERIOD_S, RATE_HZ
from mmt.testing.simulation.alterations import BURST_S
from mmt.testing.simulation.altered_surface import AlteredSurface
from mmt.testing.simulation.known_surfaces import KnownSurface
from mmt.testing.simulation.modes import maps_at
from mmt.testing.simulation.noise import NoiseRows
from mmt.testing.simulation.surfaces import HIGH_PASS_POLE, Surface

_WIDTH = pi / RATE_HZ
_ANGLE = 2.0 * pi / RATE_HZ


class VibrationSource(Protocol):
    """Makes the vibration of a surface, tick by tick."""

    def step(
        self,
        speed_mm_s: float,
        force_n: float,
        heading: tuple[float, float] = (1.0, 0.0),
        position_mm: tuple[float, float] = (0.0, 0.0),
    ) -> tuple[float, float]:
        """Return the acceleration (m/s2) along the normal and along the heading."""


def vibration_of(surface: KnownSurface, generator: np.random.Generator) -> VibrationSource:
    """Return the generator of a surface's vibration."""
    if isinstance(surface, Surface):
        return Vibration(surface, generator)
    if isinstance(surface, AlteredSurface):
        source, chance = generator.spawn(2)
        return AlteredVibration(surface, vibration_of(surface.base, source), chance)
    from mmt.testing.simulation.model_surface import ModelVibration

    return ModelVibration(surface, generator)


class Vibration:
    """A causal generator whose stationary spectrum is exactly `Surface.spectrum`.

    Each mode is a rotation of a pair of numbers that shrinks by a factor below 1 at every
    tick and is fed two white noises; one of the pair is put out. Frequency, bandwidth and
    gain follow speed, force and heading at every tick. Stability: whatever their course, a
    state only shrinks but for the noise added, which a filter in direct form
    does not guarantee. Cost: about 1 us a mode and tick.

    Parameters
    ----------
    surface
        The texture.
    generator
        Source of every random number; nothing else draws from it.
    """

    def __init__(self, surface: Surface, generator: np.random.Generator) -> None:
        self._share = surface.tangential_share
        # a part without a grain does not know the heading: one call less, four times a tick
        self._modes = [(mode, mode.maps if mode.grain is None else None) for mode in surface.modes]
        self._states = [(0.0, 0.0, 0.0, 0.0) for _ in surface.modes]
        self._noise = NoiseRows(generator, 4 * len(surface.modes))
        self._sums = (0.0, 0.0)
        self._passed = (0.0, 0.0)

    def step(
        self,
        speed_mm_s: float,
        force_n: float,
        heading: tuple[float, float] = (1.0, 0.0),
        position_mm: tuple[float, float] = (0.0, 0.0),  # noqa: ARG002 - homogeneous
    ) -> tuple[float, float]:
        """Return the acceleration (m/s2) along the normal and along the heading.

        Parameters
        ----------
        speed_mm_s, force_n
            Speed and force of the stroke.
        heading
            The unit vector of its velocity in the plane.
        position_mm
            The tip in the plane, which does not matter here.
        """
        cosine, sine = heading
        noise = self._noise.next()
        normal = along = 0.0
        for index, (mode, maps) in enumerate(self._modes):
            power, frequency, bandwidth = (
                maps(speed_mm_s, force_n)
                if maps is not None
                else maps_at(mode, speed_mm_s, force_n, cosine, sine)
            )
            radius = exp(-_WIDTH * bandwidth)
            c = radius * cos(_ANGLE * frequency)
            s = radius * sin(_ANGLE * frequency)
            gain = sqrt(power * (1.0 - radius * radius))
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
        scale = 0.5 * (1.0 + HIGH_PASS_POLE)
        before_normal, before_along = self._sums
        passed_normal = HIGH_PASS_POLE * self._passed[0] + scale * (normal - before_normal)
        passed_along = HIGH_PASS_POLE * self._passed[1] + scale * (along - before_along)
        self._sums = (normal, along)
        self._passed = (passed_normal, passed_along)
        return passed_normal, self._share * passed_along


class AlteredVibration:
    """A generator whose vibration is that of an altered surface.

    Cost: that of the surface altered, and some 5 us a tick for a level, 1 us for patches or bursts.
    """

    def __init__(
        self, surface: AlteredSurface, base: VibrationSource, generator: np.random.Generator
    ) -> None:
        self._base = base
        self._pole = surface.pole
        self._passed = (0.0, 0.0)
        self._level = surface.level
        self._gains = None if surface.patches is None else surface.patches.gains()
        self._spread = 0.0 if surface.bursts is None else surface.bursts.spread
        self._keep = exp(-2.0 * PERIOD_S / BURST_S)
        self._noise = NoiseRows(generator, 1)
        self._burst = self._noise.next()[0]

    def step(
        self,
        speed_mm_s: float,
        force_n: float,
        heading: tuple[float, float] = (1.0, 0.0),
        position_mm: tuple[float, float] = (0.0, 0.0),
    ) -> tuple[float, float]:
        """Return the acceleration (m/s2) along the normal and along the heading."""
        normal, along = self._base.step(speed_mm_s, force_n, heading, position_mm)
        pole, (normal_before, along_before) = self._pole, self._passed
        normal = (1.0 - pole) * normal + pole * normal_before
        along = (1.0 - pole) * along + pole * along_before
        self._passed = (normal, along)
        gain = 1.0
        if self._level is not None:
            gain = 10.0 ** (float(self._level.level_db(speed_mm_s, force_n)) / 20.0)
        if self._gains is not None:
            row = self._gains[floor(position_mm[1]) % len(self._gains)]
            gain *= row[floor(position_mm[0]) % len(row)]
        if self._spread:
            kick = sqrt(1.0 - self._keep**2) * self._noise.next()[0]
            self._burst = self._keep * self._burst + kick
            gain *= exp(self._spread * (self._burst - self._spread))
        return gain * normal, gain * along
