"""Correction of spectra and powers for the high-pass of the modelling.

A Butterworth filter of second order with its corner at 10 Hz leaves ``1 / (1 + (10 / f)^4)`` of
the power at f Hz: 0.94 at 20 Hz, half at 10 Hz, 0.29 at 8 Hz. Spectra that were fitted behind the
filter are divided by this share. Below `LOWEST_HZ` too little of the texture is left beside the
hand's own motion, and the share at `LOWEST_HZ` is used.

The memory of a fitted filter limits its resolution: it is 16 ms or more at 1 kHz, but 6 ms at
10 kHz, too short to show the high-pass. So if a frame has several samples of the vibration, the
lowest frequencies are those of filters that are fitted to the means of the frames.
"""

from functools import cache
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.burg import ReflectionFits
from mmt.texture.autoregression.forms import lsf_output_power, lsf_to_ar, reflection_to_ar
from mmt.texture.autoregression.reshaping import (
    TINY,
    period_of,
    reflection_of,
    relative_density,
    shares,
)
from mmt.texture.autoregression.spectra import ar_spectrum
from mmt.texture.signals.biquad import VIBRATION_CUTOFF_HZ

LOWEST_HZ: Final = 8.0

_WHOLE_HZ: Final = 100.0
"""From here on the high-pass leaves a power as it is; it takes 1e-4 of it."""

_LOW_HZ: Final = 50.0
"""Below this the means of frames give the spectrum; the high-pass takes 0.2 % of the power."""


def without_high_pass(
    fits: ReflectionFits, means: ReflectionFits | None, order: int, rate_hz: float, frame_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Return the filters of vibration before the high-pass, and its power over that behind it.

    Parameters
    ----------
    fits
        Filters fitted behind the high-pass, k of them.
    means
        Filters fitted to the means of frames, of an order that is high enough to show the
        high-pass; None if a frame has one sample.
    order
        Order of the filters that are returned.
    rate_hz, frame_hz
        Sampling rates of the vibration, and of frames.

    Returns
    -------
    reflection, gain
        Shapes (k, order) and (k,), the gain being 1 or more.
    """
    period = period_of(rate_hz)
    density = relative_density(reflection_to_ar(fits.reflection), period)
    if means is not None:
        low_hz = np.arange(0.0, min(_LOW_HZ, 0.5 * frame_hz), rate_hz / period)
        scale = np.maximum(fits.power, TINY) / (density @ shares(period))
        low = ar_spectrum(reflection_to_ar(means.reflection), means.variance, low_hz, frame_hz)
        density[:, : len(low_hz)] = 0.5 * rate_hz * low / scale[:, None]
    restored, power = reflection_of(density * _given_back(rate_hz), order)
    return restored, 2.0 * power / (density @ shares(period))


def gain_without_high_pass(lsf: FloatArray, rate_hz: float) -> FloatArray:
    """Return the power of vibration before the high-pass over that behind it, (k,).

    Parameters
    ----------
    lsf
        Line spectral frequencies of the vibration before the high-pass, (k, order).
    rate_hz
        Sampling rate.
    """
    step_hz = rate_hz / period_of(rate_hz)
    low_hz = np.arange(0.0, min(_WHOLE_HZ, 0.5 * rate_hz), step_hz)
    taken = 1.0 - 1.0 / _given_back(rate_hz)[: len(low_hz)]
    power = lsf_output_power(np.ones(len(lsf)), lsf)
    density = ar_spectrum(lsf_to_ar(lsf), 1.0, low_hz, rate_hz)
    lost = np.trapezoid(density * taken, dx=step_hz, axis=1) / power
    return np.asarray(1.0 / (1.0 - np.minimum(lost, taken[0])))


@cache
def _given_back(rate_hz: float) -> FloatArray:
    period = period_of(rate_hz)
    frequency_hz = np.arange(period // 2 + 1) * (rate_hz / period)
    return np.asarray(1.0 + (VIBRATION_CUTOFF_HZ / np.maximum(frequency_hz, LOWEST_HZ)) ** 4)
