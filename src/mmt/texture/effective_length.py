"""How many independent samples the power of a stretch of vibration is worth.

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

from mmt.arrays import FloatArray
from mmt.texture.spectra import lsf_spectrum

LEAST: Final = 2.0
"""Below this a power says next to nothing; narrower lines than the grid resolves end here."""

UNKNOWN: Final = 100.0
"""Of a sample whose length is not known: 0.6 dB."""

_FREQUENCIES: Final = np.arange(1025) / 2048.0  # cycles a sample
_WEIGHTS: Final = np.r_[0.5, np.ones(1023), 0.5] / 1024.0


def effective_samples(lsf: FloatArray, counts: FloatArray) -> FloatArray:
    """Return nu of each stretch, from `LEAST` to its number of samples.

    Parameters
    ----------
    lsf
        The filter fitted to each, shape (n, order), ascending in (0, pi).
    counts
        Samples of each, shape (n,).
    """
    if not len(lsf):
        return np.empty(0)
    density = lsf_spectrum(lsf, 1.0, _FREQUENCIES, 1.0)
    density /= density.max(axis=1, keepdims=True)
    share = np.square(density @ _WEIGHTS) / (np.square(density) @ _WEIGHTS)
    longest = np.asarray(counts, dtype=np.float64)
    return np.asarray(np.maximum(np.minimum(longest * share, longest), LEAST))


def log_power_scatter(effective: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of ln(mean square / power), each shape (n,).

    Parameters
    ----------
    effective
        Independent samples nu that each mean square is worth, positive, shape (n,).
    """
    half = 0.5 * np.asarray(effective, dtype=np.float64)
    return digamma(half) - np.log(half), polygamma(1, half)
