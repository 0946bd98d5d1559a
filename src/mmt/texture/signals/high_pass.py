"""What the high-pass of the modelling takes from spectra and powers, given back.

A Butterworth filter of second order with its corner at 10 Hz leaves ``1 / (1 + (10 / f)^4)`` of
the power at f Hz: 0.94 at 20 Hz, half at 10 Hz, 0.29 at 8 Hz. Spectra that were fitted to what
it leaves are divided by it. Below `LOWEST_HZ` there is too little of the texture left beside the
hand's own motion, and no more is given back than there.
"""

from functools import cache
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import reflection_to_ar
from mmt.texture.autoregression.reshaping import PERIOD, reflection_of, relative_density
from mmt.texture.signals.biquad import VIBRATION_CUTOFF_HZ

LOWEST_HZ: Final = 8.0


def without_high_pass(
    reflection: FloatArray, order: int, rate_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Return the filters of vibration before the high-pass, and its power over that behind it.

    Parameters
    ----------
    reflection
        Reflection coefficients of filters fitted behind the high-pass, (k, m), of an order that is
        high enough to show it.
    order
        Of the filters that are returned.
    rate_hz
        Sampling rate.

    Returns
    -------
    reflection, gain
        Shapes (k, order) and (k,), the gain being 1 or more.
    """
    density = relative_density(reflection_to_ar(reflection))
    restored, power = reflection_of(density * _given_back(rate_hz), order)
    return restored, power / (density @ _WEIGHTS)


def gain_without_high_pass(reflection: FloatArray, rate_hz: float) -> FloatArray:
    """Return the power of vibration over that which the high-pass leaves of it, (k,).

    Parameters
    ----------
    reflection
        Reflection coefficients of the vibration as it was before, (k, order).
    rate_hz
        Sampling rate.
    """
    density = relative_density(reflection_to_ar(reflection))
    return np.asarray((density @ _WEIGHTS) / (density @ (_WEIGHTS / _given_back(rate_hz))))


_WEIGHTS: Final = np.r_[0.5, np.ones(PERIOD // 2 - 1), 0.5] / PERIOD
"""Of a spectrum in its power."""


@cache
def _given_back(rate_hz: float) -> FloatArray:
    frequency_hz = np.arange(PERIOD // 2 + 1) * (rate_hz / PERIOD)
    return np.asarray(1.0 + (VIBRATION_CUTOFF_HZ / np.maximum(frequency_hz, LOWEST_HZ)) ** 4)
