"""Power spectral densities of autoregressive models, and effective sample sizes of powers."""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.bounds import real_numbers
from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt.texture.autoregression.reshaping import (
    period_of,
    relative_density,
    shares,
    squared_response,
)
from mmt.texture.linear_algebra import product

_ROUNDING: Final = np.finfo(np.float64).eps ** 2
"""Smallest squared sum over coefficients: at a pole, rounding may make the sum zero."""

LEAST_SIZE: Final = 2.0
"""Least effective sample size, that of lines narrower than the spectral grid resolves."""

UNKNOWN_SIZE: Final = 100.0
"""Effective sample size assumed if the length is not known: a scatter of 0.6 dB."""


def ar_spectrum(
    ar: FloatArray, variance: float | FloatArray, frequencies_hz: FloatArray, rate_hz: float
) -> FloatArray:
    """Return the one-sided power spectral density of filter coefficients.

    ``2 variance / rate / |A(exp(2 pi i f / rate))|^2`` at every frequency, 0 and half the
    rate included, so that the integral from 0 to rate/2 is the output's power.

    Parameters
    ----------
    ar : (m,) or (n, m)
        Without the leading 1.
    variance : () or (n,)
        Variance of the excitation.
    frequencies_hz : (f,)
        Within 0 to rate_hz / 2.
    rate_hz
        Samples a second.

    Returns
    -------
    (f,) or (n, f)
        In the square of the signal's unit per Hz.

    Raises
    ------
    InputError
        A frequency is outside the range.
    """
    rows = np.atleast_2d(ar)
    turns = np.outer(np.arange(1, rows.shape[1] + 1), _angles(frequencies_hz, rate_hz))
    real, imaginary = 1.0 + product(rows, np.cos(turns)), product(rows, np.sin(turns))
    square = np.maximum(np.square(real) + np.square(imaginary), _ROUNDING)
    return _density(variance, square.reshape(*np.shape(ar)[:-1], -1), rate_hz)


def ar_spectra(ar: FloatArray, variance: FloatArray, period: int, rate_hz: float) -> FloatArray:
    """Return `ar_spectrum` (n, period // 2 + 1) of filters (n, m) evenly from 0 to half the rate.

    It uses Fourier transforms, which take a fraction of the time.
    """
    return _density(variance, np.maximum(squared_response(ar, period), _ROUNDING), rate_hz)


def lsf_spectrum(
    lsf: FloatArray, variance: float | FloatArray, frequencies_hz: FloatArray, rate_hz: float
) -> FloatArray:
    """Return the one-sided power spectral density of line spectral frequencies.

    As `ar_spectrum`, but from ``|A|^2 = (|P|^2 + |Q|^2) / 4``, a sum of two products: it keeps
    its digits where sums over the coefficients cancel, as in low-pass filters of high order.

    Parameters
    ----------
    lsf : (m,) or (n, m)
        In (0, pi).
    variance, frequencies_hz, rate_hz
        As in `ar_spectrum`.

    Raises
    ------
    InputError
        A frequency is outside the range.
    """
    angles = _angles(frequencies_hz, rate_hz)
    zeros = np.asarray(lsf)[..., np.newaxis]
    order = zeros.shape[-2]
    # 2 (cos w - cos w_i), as a product so that its relative accuracy does not suffer near w_i
    factors = 4.0 * np.sin(0.5 * (zeros + angles)) * np.sin(0.5 * (zeros - angles))
    p = np.prod(factors[..., 0::2, :], axis=-2)
    q = np.prod(factors[..., 1::2, :], axis=-2)
    if order % 2 == 0:
        p *= 2.0 * np.cos(0.5 * angles)
        q *= 2.0 * np.sin(0.5 * angles)
    else:
        q *= 2.0 * np.sin(angles)
    return _density(variance, 0.25 * (p * p + q * q), rate_hz)


def _angles(frequencies_hz: FloatArray, rate_hz: float) -> FloatArray:
    frequencies = real_numbers("frequencies_hz", frequencies_hz)
    if not ((frequencies >= 0.0) & (frequencies <= 0.5 * rate_hz)).all():
        raise InputError(f"frequencies_hz must lie between 0 and half the rate, {0.5 * rate_hz:g}")
    angles: FloatArray = 2.0 * np.pi / rate_hz * frequencies
    return angles


def _density(variance: float | FloatArray, square: FloatArray, rate_hz: float) -> FloatArray:
    density: FloatArray = (2.0 / rate_hz) * np.asarray(variance)[..., np.newaxis] / square
    return density


def effective_samples(lsf: FloatArray, counts: FloatArray, rate_hz: float) -> FloatArray:
    """Return the effective sample size nu of each stretch, from `LEAST_SIZE` to its length, (n,).

    The mean square of N samples of a stationary Gaussian process scatters about its power P with
    the variance ``2 P^2 sum_k rho_k^2 / N``, rho_k the autocorrelation at lag k and the sum over
    all lags (Bartlett's formula at lag 0; Priestley, Spectral Analysis and Time Series, 1981,
    section 5.3.3), up to terms of the order 1/N^2. So it scatters like the mean of
    ``nu = N / sum_k rho_k^2`` squares of independent normal numbers (chi-square over its nu degrees
    of freedom). By Parseval the sum follows from the spectrum S of the fitted filter:
    ``mean(S^2) / mean(S)^2``.

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
    return np.asarray(np.maximum(longest * np.minimum(share, 1.0), LEAST_SIZE))
