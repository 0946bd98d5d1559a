"""Vibration of a known surface under a hand whose speed and force change, tick by tick."""

from math import cos, exp, pi, sqrt

import numpy as np

from mmt.devices.simulated import RATE_HZ
from mmt.devices.simulated.modes import excitation
from mmt.devices.simulated.noise import NoiseRows
from mmt.devices.simulated.surfaces import HIGH_PASS_POLE, Surface

_WIDTH = pi / RATE_HZ
_ANGLE = 2.0 * pi / RATE_HZ


class Vibration:
    """A causal generator whose stationary spectrum is exactly `Surface.spectrum`.

    Each mode is a second-order resonator in direct form with noise of its own; its
    coefficients follow speed and force at every tick. A direct form is stable for any
    course of coefficients that moves slower than the resonators ring, which speed and
    force do. Cost: about 1 us a mode and tick.

    Parameters
    ----------
    surface
        The texture.
    generator
        Source of every random number; nothing else draws from it.
    """

    def __init__(self, surface: Surface, generator: np.random.Generator) -> None:
        self._share = surface.tangential_share
        self._maps = [mode.maps for mode in surface.modes]
        self._states = [[0.0, 0.0, 0.0, 0.0] for _ in surface.modes]
        self._noise = NoiseRows(generator, 2 * len(surface.modes))
        self._sums = (0.0, 0.0)
        self._passed = (0.0, 0.0)

    def step(self, speed_mm_s: float, force_n: float) -> tuple[float, float]:
        """Return the acceleration (m/s2) along the normal and along the heading."""
        noise = self._noise.take()
        normal = along = 0.0
        index = 0
        for maps, state in zip(self._maps, self._states, strict=True):
            power, frequency, bandwidth = maps(speed_mm_s, force_n)
            radius = exp(-_WIDTH * bandwidth)
            b = 2.0 * radius * cos(_ANGLE * frequency)
            c = radius * radius
            gain = sqrt(power * excitation(b, c))
            first, second, third, fourth = state
            value = b * first - c * second + gain * noise[index]
            other = b * third - c * fourth + gain * noise[index + 1]
            state[:] = (value, first, other, third)
            normal += value
            along += other
            index += 2
        return self._high_pass(normal, along)

    def _high_pass(self, normal: float, along: float) -> tuple[float, float]:
        scale = 0.5 * (1.0 + HIGH_PASS_POLE)
        before_normal, before_along = self._sums
        passed_normal = HIGH_PASS_POLE * self._passed[0] + scale * (normal - before_normal)
        passed_along = HIGH_PASS_POLE * self._passed[1] + scale * (along - before_along)
        self._sums = (normal, along)
        self._passed = (passed_normal, passed_along)
        return passed_normal, self._share * passed_along
