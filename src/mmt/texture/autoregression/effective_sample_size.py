"""Effective sample size of the power of a stretch of vibration.

The mean square of N samples of a stationary Gaussian process scatters about its power P with
the variance ``2 P^2 sum_k rho_k^2 / N``, rho_k the autocorrelation at lag k and the sum over all
lags (Bartlett's formula at lag 0; Priestley, Spectral Analysis and Time Series, 1981, section
5.3.3), up to terms of the order 1/N^2. So it scatters like the mean of ``nu = N / sum_k rho_k^2``
squares of independent normal numbers (chi-square over its nu degrees of freedom). By Parseval the
sum follows from the spectrum S of the fitted filter: ``mean(S^2) / mean(S)^2``.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt.texture.autoregression.reshaping import period_of, relative_density, shares

LEAST: Final = 2.0
"""Least effective sample size, that of lines narrower than the spectral grid resolves."""

UNKNOWN: Final = 100.0
"""Effective sample size assumed if the length is not known: a scatter of 0.6 dB."""


def effective_samples(lsf: FloatArray, counts: FloatArray, rate_hz: float) -> FloatArray:
    """Return the effective sample size nu of each stretch, from `LEAST` to its length, (n,).

    Parameters
    ----------
    lsf
        Line spectral frequencies (rad) of the filter fitted to each, shape (n, order), ascending
        in (0, pi).
    counts
        Number of samples of each, shape (n,).
    rate_hz
        Sampling rate.
    """
    if not len(lsf):
        return np.empty(0)
    period = period_of(rate_hz)
    density, weights = relative_density(lsf_to_ar(lsf), period), shares(period)
    share = np.square(density @ weights) / (np.square(density) @ weights)
    longest = np.asarray(counts, dtype=np.float64)
    return np.asarray(np.maximum(longest * np.minimum(share, 1.0), LEAST))
