"""Vibration of an altered surface: that of its base, low-passed and times the gains."""

from math import exp, floor, sqrt

import numpy as np

from mmt.testing.simulation.alterations import burst_decay
from mmt.testing.simulation.altered_surface import AlteredSurface
from mmt.testing.simulation.noise import NoiseRows
from mmt.testing.simulation.vibration import VibrationSource


class AlteredVibration(VibrationSource):
    """A generator of the vibration of an altered surface.

    Cost: that of the unaltered surface, plus some 5 us a call of `run` for a level, and 1 us for
    patches or for each sample of bursts.
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
        self._keep = exp(-burst_decay(surface.rate_hz))
        self._noise = NoiseRows(generator, 1)
        self._burst = self._noise.next()[0]

    def run(
        self,
        count: int,
        speed_mm_s: float,
        force_n: float,
        heading: tuple[float, float] = (1.0, 0.0),
        position_mm: tuple[float, float] = (0.0, 0.0),
    ) -> list[tuple[float, float]]:
        """Return the next samples; see `VibrationSource.run`."""
        gain = 1.0
        if self._level is not None:
            gain = 10.0 ** (float(self._level.level_db(speed_mm_s, force_n)) / 20.0)
        if self._gains is not None:
            row = self._gains[floor(position_mm[1]) % len(self._gains)]
            gain *= row[floor(position_mm[0]) % len(row)]
        made = self._base.run(count, speed_mm_s, force_n, heading, position_mm)
        return [self._altered(normal, along, gain) for normal, along in made]

    def _altered(self, normal: float, along: float, gain: float) -> tuple[float, float]:
        """Return a sample after the low-pass, times this gain and that of the bursts."""
        pole, (normal_before, along_before) = self._pole, self._passed
        normal = (1.0 - pole) * normal + pole * normal_before
        along = (1.0 - pole) * along + pole * along_before
        self._passed = (normal, along)
        if self._spread:
            kick = sqrt(1.0 - self._keep**2) * self._noise.next()[0]
            self._burst = self._keep * self._burst + kick
            gain *= exp(self._spread * (self._burst - self._spread))
        return gain * normal, gain * along
