"""Effective sample size of the power of a stretch of vibration.

The mean square of N samples of a stationary Gaussian process scatters about its power P with
the variance ``2 P^2 sum_k rho_k^2 / N``, rho_k the autocorrelation at lag k and the sum over all
lags (Bartlett's formula at lag 0; Priestley, Spectral Analysis and Time Series, 1981, section
5.3.3), but for terms of the order 1/N^2. So it scatters as the mean of ``nu = N / sum_k rho_k^2``
squares of independent normal numbers, a chi-square number over its nu degrees of freedom, does.
By Parseval the sum follows from the spectrum S of the fitted filter: ``mean(S^2) / mean(S)^2``.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt.texture.autoregression.reshaping import PERIOD, relative_density

LEAST: Final = 2.0
"""Least effective sample size: narrower lines than the spectral grid resolves end here."""

UNKNOWN: Final = 100.0
"""Effective sample size assumed where the length is not known: a scatter of 0.6 dB."""

_WEIGHTS: Final = np.r_[0.5, np.ones(PERIOD // 2 - 1), 0.5] / (PERIOD // 2)


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
    density = relative_density(lsf_to_ar(np.array(lsf)))
    share = np.square(density @ _WEIGHTS) / (np.square(density) @ _WEIGHTS)
    return np.asarray(np.minimum(share, 1.0))
