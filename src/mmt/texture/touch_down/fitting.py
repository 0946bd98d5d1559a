"""Fit of a transient to recorded touch-downs.

No filter is fitted: the most typical of each group of touch-downs of similar speed represents it.
On the taps of the Penn Haptic Texture Toolkit an autoregressive impulse response, or the first
singular vector of all, has larger errors: a transient's spectrum rises with the speed, and a filter
of minimum phase decays too soon.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.touch_down.finding import TouchDown
from mmt.texture.touch_down.transient import MOST_SHAPES, STEEPEST, Law, Transient

LEAST: Final = 3
"""Least number of touch-downs for a transient, and in a group of similar speed."""

_USUAL_EXPONENT: Final = 0.7
"""Exponent of the amplitude over the speed, if the speeds are too similar to estimate one."""
_APART: Final = math.log(1.5)
"""Logarithm of the ratio of two speeds above which the pair counts for the exponent."""
_LEAST_PAIRS: Final = 3
_NEPER_DB: Final = 20.0 / math.log(10.0)
_NORMAL: Final = 1.4826
"""Standard deviation of normal numbers over their median magnitude."""
_LOWEST_HZ: Final = 20.0
_BANDS: Final = 12
_PERIOD: Final = 2048
_FLOOR: Final = 1e-9


def fit_transient(touch_downs: Sequence[TouchDown], rate_hz: float) -> Transient | None:
    """Return the transient of a surface, or None for fewer than `LEAST` touch-downs.

    The exponent is the median of the slopes of pairs (Theil and Sen), amplitude and error are
    medians too: one bad touch-down in four changes little.

    Parameters
    ----------
    touch_downs
        With windows of one length, in any order.
    rate_hz
        Sampling rate of the acceleration.
    """
    if len(touch_downs) < LEAST:
        return None
    ordered = sorted(touch_downs, key=lambda each: (each.speed_mm_s, each.frame))
    speeds = np.array([each.speed_mm_s for each in ordered])
    windows = np.array([each.vibration_m_s2 for each in ordered])
    roots = np.sqrt([each.energy for each in ordered])
    scaled = windows * np.sqrt(rate_hz / np.square(windows).sum(axis=1, keepdims=True))
    levels_db = band_levels_db(scaled, rate_hz)
    groups = np.array_split(np.arange(len(ordered)), min(MOST_SHAPES, len(ordered) // LEAST))
    typical = [group[_most_typical(levels_db[group])] for group in groups]
    middle = np.array([np.median(speeds[group]) for group in groups])
    return Transient(middle, scaled[typical], _law(speeds, roots))


def band_levels_db(windows: FloatArray, rate_hz: float) -> FloatArray:
    """Return the energy of windows (m, n) by bands of even ratio from 20 Hz up, in dB, (m, b)."""
    spectra = np.fft.rfft(windows, _PERIOD, axis=1)
    density = np.square(spectra.real) + np.square(spectra.imag)
    edges_hz = np.geomspace(_LOWEST_HZ, 0.5 * rate_hz, _BANDS + 1)
    bins = np.searchsorted(np.fft.rfftfreq(_PERIOD, 1.0 / rate_hz), edges_hz)
    energy = np.add.reduceat(density, bins[:-1], axis=1) * 2.0 / (_PERIOD * rate_hz)
    return np.asarray(10.0 * np.log10(energy + _FLOOR))


def _most_typical(levels_db: FloatArray) -> int:
    """Return the row whose distance from all the others is least in the sum."""
    squares = np.square(levels_db[:, None] - levels_db[None]).mean(axis=2)
    return int(np.argmin(np.sqrt(squares).sum(axis=1)))


def _law(speeds_mm_s: FloatArray, roots: FloatArray) -> Law:
    x, y = np.log(speeds_mm_s / 100.0), np.log(roots)
    first, second = np.triu_indices(len(x), 1)
    apart = x[second] - x[first]
    told = apart > _APART
    exponent = _USUAL_EXPONENT
    if np.count_nonzero(told) >= _LEAST_PAIRS:
        exponent = float(np.median((y[second] - y[first])[told] / apart[told]))
        exponent = min(max(exponent, 0.0), STEEPEST)
    left = y - exponent * x
    level = float(np.median(left))
    error_db = _NEPER_DB * _NORMAL * float(np.median(np.abs(left - level)))
    slowest, fastest = float(speeds_mm_s[0]), float(speeds_mm_s[-1])
    return Law(math.exp(level), exponent, slowest, fastest, error_db)


@dataclass(frozen=True)
class HeldOutErrors:
    """Errors of touch-downs, each rendered by a transient that was learnt from the others.

    ``count``: number of touch-downs. ``energy_db``: mean magnitude of the error of their energy,
    in dB. ``spectrum_db``: mean of their root mean square errors by bands, in dB.
    """

    count: int
    energy_db: float
    spectrum_db: float

    @property
    def sentence(self) -> str:
        """The errors as a sentence."""
        return (
            f"Rendered from all others, each of {self.count} touch-downs is off by "
            f"{self.energy_db:.1f} dB in energy and {self.spectrum_db:.1f} dB in its spectrum."
        )


def held_out_errors(touch_downs: Sequence[TouchDown], rate_hz: float) -> HeldOutErrors | None:
    """Return the errors with each touch-down left out once, or None if there are too few."""
    energy_db, spectrum_db = [], []
    for place, left_out in enumerate(touch_downs):
        others = [*touch_downs[:place], *touch_downs[place + 1 :]]
        transient = fit_transient(others, rate_hz)
        if transient is None:
            return None
        rendered = transient.response(left_out.speed_mm_s)
        energy = float(np.square(rendered).sum()) / rate_hz
        energy_db.append(abs(10.0 * math.log10(energy / left_out.energy)))
        both = band_levels_db(np.array([rendered, left_out.vibration_m_s2]), rate_hz)
        spectrum_db.append(float(np.sqrt(np.square(both[0] - both[1]).mean())))
    if not energy_db:
        return None
    return HeldOutErrors(len(energy_db), float(np.mean(energy_db)), float(np.mean(spectrum_db)))
