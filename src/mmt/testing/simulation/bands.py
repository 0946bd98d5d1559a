"""What a known texture has above 500 Hz, where the acceleration is faster than 1 kHz."""

from dataclasses import replace
from itertools import pairwise
from math import pi
from typing import Final

import numpy as np

from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.modes import Mode, Resonance
from mmt.testing.simulation.surfaces import Surface

_EDGES_HZ: Final = np.geomspace(600.0, 4200.0, 7)
"""One resonance is drawn between two of these."""

_HIGHEST: Final = 0.42
"""Share of the rate below which a resonance begins, so that none reaches half the rate."""

_LARGEST_SHIFT: Final = 0.1


def with_bands(surface: Surface, rate_hz: float, seed: int) -> Surface:
    """Return a surface at a rate, with resonances above 500 Hz as far as the rate has room.

    Below 500 Hz it keeps its own parts. The others carry on from the density that these have
    there, by 1.5 +- 0.5 powers of the frequency and 3.5 dB of chance; each follows speed, force and
    heading as one of the surface's own parts does. A higher rate has all that a lower one has.

    Parameters
    ----------
    surface
        At 1 kHz.
    rate_hz
        Samples of acceleration a second.
    seed
        Says which resonances.
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
