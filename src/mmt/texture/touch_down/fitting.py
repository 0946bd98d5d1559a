"""Touch-downs found in a stream, and the transient that is fitted to them.

A contact begins when the smoothed force rises above half of the least force that is modelled, after
a quiet time in the air. Smoothing blurs the rise, so the onset is taken where the vibration sets in
nearby. The energy of what follows (texture and sensor noise) is subtracted. A touch-down whose
energy does not stand out from that before and after it is left out.

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
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock, dft321
from mmt.texture.touch_down import WINDOW_S
from mmt.texture.touch_down.transient import MOST_SHAPES, STEEPEST, Law, Transient

QUIET_S: Final = 0.1
"""Least time in the air before a contact."""

_EARLY_S: Final = 0.01
_LATE_S: Final = 0.025
"""How far before and behind the rise of the smoothed force the vibration may set in."""
_SMEARED_S: Final = 0.011
"""Time before the onset for which the contact already affects the smoothed position."""
_SLOPE_S: Final = 0.004
_ONSET: Final = 0.1
"""Share of the largest power of a frame, from which on the vibration has set in."""
_STANDS_OUT: Final = 2.0
"""Least ratio of the energy to that before and to that after it."""
_FADE: Final = 0.2
"""Share of the window, at its end, over which it is faded to zero."""
_LEAST_MM_S: Final = 1.0
_AXES: Final = "xyz"

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


@dataclass(frozen=True, eq=False)
class TouchDown:
    """One touch-down.

    Attributes
    ----------
    frame
        Sequence number of the frame of its onset.
    speed_mm_s
        Speed into the surface just before it.
    vibration_m_s2 : (n,)
        From a frame before the onset on, faded out.
    energy
        Sum of squares over the rate, less that of what follows, (m/s2)^2 s.
    """

    frame: int
    speed_mm_s: float
    vibration_m_s2: FloatArray
    energy: float


class TouchDownFinder:
    """Find touch-downs in a stream of aligned samples; its partition does not change them.

    Parameters
    ----------
    settings
        Rate, axes and least force.
    """

    def __init__(self, settings: ModellingSettings) -> None:
        rate_hz = settings.rate_hz
        self._settings = settings
        self._normal = _AXES.index(settings.normal)
        self._threshold_n = 0.5 * settings.least_force_n
        self._quiet, self._window = round(QUIET_S * rate_hz), round(WINDOW_S * rate_hz)
        self._early, self._late = round(_EARLY_S * rate_hz), math.ceil(_LATE_S * rate_hz)
        self._smeared = math.ceil(_SMEARED_S * rate_hz)
        self._slope = max(1, round(_SLOPE_S * rate_hz))
        earlier = max(self._window + 1, self._smeared + self._slope)
        self._before = max(self._quiet, self._early + earlier)
        self._after = self._late + 2 * self._window
        count = self._window * settings.samples_per_frame
        faded = np.linspace(0.0, math.pi, round(_FADE * count))
        self._taper = np.ones(count)
        self._taper[count - len(faded) :] = 0.5 + 0.5 * np.cos(faded)
        self._rest = AlignedBlock.empty()

    def update(self, aligned: AlignedBlock) -> list[TouchDown]:
        """Add the next samples (n,), and return the touch-downs that are now complete."""
        joined = AlignedBlock.concatenate([self._rest, aligned]) if len(self._rest) else aligned
        pressed = joined.normal_force_n >= self._threshold_n
        begun = np.flatnonzero(pressed[1:] & ~pressed[:-1]) + 1
        stop = max(len(joined) - self._after, self._before)
        found = [self._measured(joined, at) for at in begun.tolist() if self._before <= at < stop]
        self._rest = joined[max(0, stop - self._before) :]
        return [each for each in found if each is not None]

    def _measured(self, joined: AlignedBlock, at: int) -> TouchDown | None:
        """Return the touch-down whose force rises at row `at`, or None if it is none."""
        part = joined[at - self._before : at + self._after]
        force_n = part.normal_force_n[self._before - self._quiet : self._before]
        whole = part.index[-1] - part.index[0] == len(part) - 1
        whole = whole and bool((part.valid & part.measured).all())
        if not whole or (force_n >= self._threshold_n).any():
            return None
        power = np.square(part.vibration_m_s2).sum(axis=(1, 2))
        looked = power[self._before - self._early : self._before + self._late]
        onset = self._before - self._early + int(np.argmax(looked >= _ONSET * looked.max()))
        end = onset - self._smeared
        rows = part.position_mm[[end - self._slope, end], self._normal]
        speed_mm_s = float(rows[0] - rows[1]) * self._settings.rate_hz / self._slope
        vibration, energy = self._stretch(part, onset - 1)
        _, before = self._stretch(part, onset - 1 - self._window)
        _, behind = self._stretch(part, onset - 1 + self._window)
        if speed_mm_s < _LEAST_MM_S or not energy > _STANDS_OUT * max(before, behind):
            return None
        return TouchDown(int(part.index[onset]), speed_mm_s, vibration, energy - behind)

    def _stretch(self, part: AlignedBlock, start: int) -> tuple[FloatArray, float]:
        """Return a window from a row on, and its energy."""
        samples = part.vibration_m_s2[start : start + self._window]
        samples = samples.reshape(-1, samples.shape[2])
        vibration = self._taper * (dft321(samples) if samples.shape[1] == 3 else samples[:, 0])
        energy = float(np.square(vibration).sum()) / self._settings.vibration_rate_hz
        return vibration, energy


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
