"""Filters with given spectra.

The filter of order p with the first p + 1 autocorrelations of a spectrum is the best of its order
in the sense of linear prediction (Markel and Gray, Linear Prediction of Speech, 1976, section
3.3). It follows by Levinson's recursion and is stable, as autocorrelations are positive definite.
"""

import math
from functools import cache
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray

LARGEST_REFLECTION: Final = 1.0 - 1e-9
TINY: Final = 1e-300
_RESOLVED_HZ: Final = 1.25
_LEAST_PERIOD: Final = 1024


def period_of(rate_hz: float) -> int:
    """Return the period of autocorrelations in samples at a sampling rate: a power of two.

    Spectra have half as many frequencies and one more, at most 1.25 Hz apart.
    """
    return max(_LEAST_PERIOD, 1 << math.ceil(math.log2(max(rate_hz / _RESOLVED_HZ, 1.0))))


@cache
def shares(period: int) -> FloatArray:
    """Return the weights of a spectrum's frequencies in its mean, (f,)."""
    inside = np.ones(period // 2 - 1)
    return np.asarray(np.r_[0.5, inside, 0.5] / (period // 2))


def relative_density(ar: FloatArray, period: int) -> FloatArray:
    """Return the spectra of filters over their maxima, from 0 to half the rate, (k, f).

    Parameters
    ----------
    ar
        Filter coefficients without the leading 1, shape (k, order).
    period
        See `period_of`.
    """
    inverse = np.maximum(squared_response(ar, period), TINY)
    return np.asarray(inverse.min(axis=1, keepdims=True) / inverse)


def squared_response(ar: FloatArray, period: int) -> FloatArray:
    """Return ``|A|^2`` of filter coefficients (k, m) evenly from 0 to half the rate, (k, f)."""
    response = np.fft.rfft(np.insert(ar, 0, 1.0, axis=1), period, axis=1)
    return np.asarray(np.square(response.real) + np.square(response.imag))


def reflection_of(density: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Return the filters of an order that have the autocorrelations of spectra.

    Parameters
    ----------
    density
        One-sided, for a rate of 1, from 0 to 0.5 evenly, not negative, (k, f).
    order
        At least 1.

    Returns
    -------
    reflection, power
        Shapes (k, order) and (k,).
    """
    lags = np.fft.irfft(0.5 * density, axis=1)[:, : order + 1]
    lags[:, 0] = np.maximum(lags[:, 0], TINY)
    return levinson(lags), lags[:, 0]


def levinson(autocorrelation: FloatArray) -> FloatArray:
    """Return the reflection coefficients (k, m) of autocorrelations (k, m + 1), O(k m^2).

    The first column is positive. If rounding leaves nothing to predict, the coefficients stay
    within `LARGEST_REFLECTION`.
    """
    count, order = autocorrelation.shape[0], autocorrelation.shape[1] - 1
    reflection, error = np.zeros((count, order)), autocorrelation[:, 0].copy()
    coefficients = np.zeros((count, order + 1))
    coefficients[:, 0] = 1.0
    for stage in range(order):
        backwards = autocorrelation[:, stage + 1 : 0 : -1]
        k = -np.einsum("ij,ij->i", coefficients[:, : stage + 1], backwards) / error
        k = np.clip(k, -LARGEST_REFLECTION, LARGEST_REFLECTION)
        coefficients[:, 1 : stage + 2] += k[:, None] * coefficients[:, stage::-1][:, : stage + 1]
        reflection[:, stage] = k
        error *= 1.0 - np.square(k)
    return reflection
