"""Touch-downs in a stream, each with its approach speed and its vibration.

A contact begins when the smoothed force rises above half of the least force that is modelled, after
a quiet time in the air. Smoothing blurs the rise, so the onset is taken where the vibration sets in
nearby. The energy of what follows (texture and sensor noise) is subtracted. A touch-down whose
energy does not stand out from that before and after it is left out.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.dft321 import dft321
from mmt.texture.touch_down import WINDOW_S

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
