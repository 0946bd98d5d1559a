"""The vibration of a known texture above 500 Hz, for acceleration faster than 1 kHz."""

from dataclasses import replace
from itertools import pairwise
from math import pi
from typing import Final

import numpy as np

from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.modes import Mode, Resonance
from mmt.testing.simulation.surfaces import Surface

_EDGES_HZ: Final = np.geomspace(600.0, 4200.0, 7)
"""One resonance is drawn between each two of these."""

_HIGHEST: Final = 0.42
"""Highest frequency of a resonance over the rate, so that none reaches half the rate."""

_LARGEST_SHIFT: Final = 0.1


def with_bands(surface: Surface, rate_hz: float, seed: int) -> Surface:
    """Return a surface at a rate, with resonances above 500 Hz as far as the rate allows.

    The surface keeps its own parts. The new resonances continue from the density below 500 Hz: they
    fall with the frequency to the power of 1.5 +- 0.5, with 3.5 dB of chance. Each follows speed,
    force and heading like one of the surface's parts. A higher rate has all those of a lower one.

    Parameters
    ----------
    surface
        At 1 kHz.
    rate_hz
        Samples of acceleration a second.
    seed
        Seed of the resonances.
    """
    if rate_hz == RATE_HZ:
        return surface
    random = np.random.default_rng([seed, 41])
    reference = surface.spectrum(100.0, 1.0, np.linspace(300.0, 500.0, 41), 0.0).mean()
    slope = random.normal(-1.5, 0.5)
    above: list[Mode] = []
    for low, high in pairwise(_EDGES_HZ):
        frequency = float(low * (high / low) ** random.random())
        bandwidth = float(frequency * 0.03 * 10.0 ** random.random())
        peak = reference * (frequency / 500.0) ** slope * 10.0 ** random.normal(0.0, 0.35)
        speed_shift, force_shift = random.uniform(-_LARGEST_SHIFT, _LARGEST_SHIFT, 2) * frequency
        followed = surface.modes[int(random.integers(len(surface.modes)))]
        resonance = Resonance(
            power=float(0.5 * pi * bandwidth * peak),
            speed_exponent=followed.speed_exponent,
            force_exponent=followed.force_exponent,
            frequency_hz=frequency,
            bandwidth_hz=bandwidth,
            speed_shift_hz=float(speed_shift),
            force_shift_hz=float(force_shift),
            grain=followed.grain,
        )
        if frequency < _HIGHEST * rate_hz:
            above.append(resonance)
    return replace(surface, modes=(*surface.modes, *above), rate_hz=rate_hz)
