"""Alterations of the vibration of a known surface: a level, patches, bursts."""

from dataclasses import dataclass
from functools import cached_property
from math import log, pi, sqrt
from typing import Final, Literal

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.testing.simulation.strokes import REACH_MM

Quantity = Literal["speed", "force"]

BURST_S: Final = 0.025
"""How long a burst lasts: the integral of the autocorrelation of the gain's logarithm."""

PATCH_MM: Final = 19.0
"""Mean distance of patches, which are 12 to 30 mm across."""

LAGS: Final = 2048
"""Samples at 1 kHz after which the correlation of any vibration has decayed."""

_PART: Final = 128  # frequencies at once, which bounds the memory
_PATCHES: Final = 11  # along each side of a square that repeats itself
_STEEP: Final = 25.0  # of a threshold, whose width is some 10 % of its speed or force


def burst_decay(rate_hz: float) -> float:
    """Return the rate, per sample, at which the correlation of the bursts' gain decays."""
    return 2.0 * (1.0 / rate_hz) / BURST_S


@dataclass(frozen=True)
class Level:
    """A level over speed v and force F, in dB, that follows no power law.

    Attributes
    ----------
    waves
        (depth_db, p, q, phase) each: ``depth_db cos(p log(v / 100 + .1) + q log(F + .1) + phase)``.
    thresholds
        (of, at, step_db) each: a step at this ``"speed"`` (mm/s) or ``"force"`` (N).
    """

    waves: tuple[tuple[float, float, float, float], ...] = ()
    thresholds: tuple[tuple[Quantity, float, float], ...] = ()

    def level_db(self, speed_mm_s: FloatArray | float, force_n: FloatArray | float) -> FloatArray:
        """Return the level (k,) at speeds and forces (k,), or that at a single speed and force."""
        along, across = np.log(speed_mm_s * 0.01 + 0.1), np.log(force_n + 0.1)
        depth, p, q, phase = self._columns
        waves = np.cos(np.multiply.outer(along, p) + np.multiply.outer(across, q) + phase)
        level = waves @ depth
        for of, at, step_db in self.thresholds:
            beyond = along - log(at * 0.01 + 0.1) if of == "speed" else across - log(at + 0.1)
            level = level + step_db * (0.5 + 0.5 * np.tanh(_STEEP * beyond))
        return np.asarray(level)

    @cached_property
    def _columns(self) -> FloatArray:
        return np.reshape(self.waves, (-1, 4)).T


@dataclass(frozen=True)
class Patches:
    """Patches of the surface whose levels are normal with this standard deviation (dB).

    Over the reach of a hand their mean power and their deviation are exactly those stated.
    """

    deviation_db: float
    seed: int

    def gains(self) -> list[list[float]]:
        """Return the amplitude gain on each mm of a square that repeats itself, by y, x."""
        random = np.random.default_rng([self.seed, 12])
        side = round(_PATCHES * PATCH_MM)
        cells = np.stack(np.meshgrid(np.arange(_PATCHES), np.arange(_PATCHES)), -1).reshape(-1, 2)
        sites = (cells + random.uniform(0.1, 0.9, cells.shape)) * (side / _PATCHES)
        place = np.arange(side) + 0.5
        gap = np.abs(place[:, None] - sites.T[:, None, :])  # (2, side, sites)
        x, y = np.minimum(gap, side - gap) ** 2
        patch = np.argmin(y[:, None, :] + x[None, :, :], axis=-1)
        # the square's corners are the centre of the workspace
        away = np.minimum(place, side - place)
        near = np.hypot(away[:, None], away[None, :]) < REACH_MM
        level = random.standard_normal(len(sites))[patch]
        level = (level - level[near].mean()) * (self.deviation_db / level[near].std())
        power = 10.0 ** (level / 10.0)
        rows: list[list[float]] = np.sqrt(power / power[near].mean()).tolist()
        return rows


@dataclass(frozen=True)
class Bursts:
    """A log-normal gain over time that gives the vibration this kurtosis (3 without the gain)."""

    kurtosis: float

    @property
    def spread(self) -> float:
        """Standard deviation of the gain's natural logarithm."""
        return 0.5 * sqrt(log(self.kurtosis / 3.0))

    def widened(
        self, density: FloatArray, frequencies_hz: FloatArray, rate_hz: float
    ) -> FloatArray:
        """Return the density (k, f) with bursts of one (k, lags + 1) from 0 to half the rate."""
        lags = np.arange(density.shape[1] - 1)
        kept = np.exp(-burst_decay(rate_hz) * lags)
        gain = np.exp(-(self.spread**2) * (1.0 - kept))
        correlation = np.fft.irfft(density, axis=1)[:, : len(lags)] * gain
        correlation[:, 1:] *= 2.0
        parts = [
            correlation @ np.cos(2.0 * pi / rate_hz * np.outer(lags, part))
            for part in np.split(frequencies_hz, range(_PART, len(frequencies_hz), _PART))
        ]
        return np.concatenate(parts, axis=1)
