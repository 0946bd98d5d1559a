"""Effective sample size of the power of a stretch of vibration.

The mean square of N samples of a stationary Gaussian process scatters about its power P with
the variance ``2 P^2 sum_k rho_k^2 / N``, rho_k the autocorrelation at lag k and the sum over all
lags (Bartlett's formula at lag 0; Priestley, Spectral Analysis and Time Series, 1981, section
5.3.3), but for terms of the order 1/N^2. So it scatters as the mean of ``nu = N / sum_k rho_k^2``
squares of independent normal numbers, a chi-square number over its nu degrees of freedom, does.
By Parseval the sum follows from the spectrum S of the fitted filter: ``mean(S^2) / mean(S)^2``.

For a chi-square number over nu the logarithm has the mean ``psi(nu/2) - ln(nu/2)`` and the
variance ``psi'(nu/2)``, both exact (digamma and trigamma): about -1/nu and 2/nu.
"""

from typing import Final

import numpy as np
from scipy.special import digamma, polygamma

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_ar

LEAST: Final = 2.0
"""Least effective sample size: narrower lines than the spectral grid resolves end here."""

UNKNOWN: Final = 100.0
"""Effective sample size assumed where the length is not known: a scatter of 0.6 dB."""

_PERIOD: Final = 1024  # lines of 1 Hz at 1 kHz
_WEIGHTS: Final = np.r_[0.5, np.ones(_PERIOD // 2 - 1), 0.5] / (_PERIOD // 2)
_TINY: Final = 1e-300


def effective_samples(lsf: FloatArray, counts: FloatArray) -> FloatArray:
    """Return the effective sample size nu of each stretch, from `LEAST` to its length, (n,).

    Parameters
    ----------
    lsf
        Line spectral frequencies (rad) of the filter fitted to each, shape (n, order), ascending
        in (0, pi).
    counts
        Number of samples of each, shape (n,).
    """
    longest = np.asarray(counts, dtype=np.float64)
    return np.asarray(np.maximum(longest * _independent(lsf), LEAST))


def _independent(lsf: FloatArray) -> FloatArray:
    """Return effective over actual sample size, above 0 and at most 1, shape (n,)."""
    if not len(lsf):
        return np.empty(0)
    response = np.fft.rfft(np.insert(lsf_to_ar(np.array(lsf)), 0, 1.0, axis=1), _PERIOD, axis=1)
    inverse = np.maximum(np.square(response.real) + np.square(response.imag), _TINY)
    density = inverse.min(axis=1, keepdims=True) / inverse
    share = np.square(density @ _WEIGHTS) / (np.square(density) @ _WEIGHTS)
    return np.asarray(np.minimum(share, 1.0))


def log_power_scatter(effective: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of ln(mean square / power), each shape (n,).

    Parameters
    ----------
    effective
        Effective sample size nu of each mean square, positive, shape (n,).
    """
    half = 0.5 * np.asarray(effective, dtype=np.float64)
    return digamma(half) - np.log(half), polygamma(1, half)
