"""Autoregressive filters: their forms, their spectra, and effective sample sizes of powers.

Awan et al., section V.C, and Culbertson et al. 2014 model a piece of vibration as white noise
through an all-pole filter, ``x[n] + sum_j a[j] x[n-1-j] = e[n]``. Every form below is of shape
(m,) for one model or (n, m) for a batch, of order m from 1 to 64, odd or even:

- reflection coefficients, which Burg's method finds, each of magnitude below one;
- filter coefficients, without the leading 1;
- line spectral frequencies in radians a sample, strictly ascending in (0, pi); they can be
  interpolated, since an average of ordered frequencies is ordered, hence stable.

A line spectral frequency is accurate to a rounding of itself. A filter given by its frequencies is
recovered to about 1e-14, near the unit circle to 1e-11. But there neighbouring frequencies are so
close that roundings decide which filter they give. Converting reflection coefficients to
frequencies and back changes ``1 - |k|`` by a relative error of some 1e-16, at most 4e-15, over the
least gap between two of the frequencies, 0 and pi included. At order 16 with coefficients drawn
evenly the error is 4e-12 in the median. With every ``|k|`` above 0.9 it is 2e-3, and in one filter
of five ``1 - |k|`` is lost. Even then the filter is stable, with its lines in place, and so it is
accepted: a pure tone must not end a model. If ``1 - |k|`` matters, keep reflection coefficients.

Filter coefficients are less accurate: a conversion from them multiplies the error by a factor of up
to ``prod (1 + |k|)/(1 - |k|)``. For a low-pass filter of high order nothing is left.
"""

from collections.abc import Callable
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.bounds import real_numbers
from mmt.core.errors import InputError
from mmt.texture.autoregression import LARGEST_ORDER, TINY
from mmt.texture.autoregression.burg import (
    period_of,
    relative_density,
    shares,
    squared_response,
)
from mmt.texture.autoregression.lsf import (
    ar_to_reflection_each_into,
    are_lsf,
    lsf_inverse_gain_each_into,
    lsf_to_ar_each_into,
    reflection_to_ar_each_into,
)
from mmt.texture.autoregression.split import (
    lsf_to_reflection_each_into,
    reflection_to_lsf_each_into,
)
from mmt.texture.linear_algebra import product


def reflection_to_ar(reflection: FloatArray) -> FloatArray:
    """Return the filter coefficients of reflection coefficients (the Levinson step-up).

    Raises
    ------
    InputError
        A coefficient's magnitude is not below one, or the order is out of range.
    """
    return _convert(_checked_reflection(reflection), reflection_to_ar_each_into)


def ar_to_reflection(ar: FloatArray) -> FloatArray:
    """Return the reflection coefficients of filter coefficients (the Levinson step-down).

    The error is up to about ``1e-16 prod (1 + |k|)/(1 - |k|)``.

    Raises
    ------
    InputError
        A filter is not stable, within that error, or the order is out of range.
    """
    result = _convert(_checked("ar", ar), ar_to_reflection_each_into)
    if np.isnan(result).any():
        raise InputError(
            "ar: the filter is not stable, or so near to it that its coefficients do not"
            " tell: give reflection coefficients or line spectral frequencies"
        )
    return result


def reflection_to_lsf(reflection: FloatArray) -> FloatArray:
    """Return the line spectral frequencies of reflection coefficients; error about 1e-15.

    See `mmt.texture.autoregression.split` for the method. Frequencies closer than a rounding are
    moved apart by one.

    Raises
    ------
    InputError
        A coefficient's magnitude is not below one, or the order is out of range.
    """
    return _convert(_checked_reflection(reflection), reflection_to_lsf_each_into)


def lsf_to_reflection(lsf: FloatArray) -> FloatArray:
    """Return the reflection coefficients of line spectral frequencies.

    The error is about 1e-14, near the unit circle 1e-11. For coefficients that were converted
    to frequencies before, see the module's docstring.

    Raises
    ------
    InputError
        The frequencies do not ascend strictly inside (0, pi), lie too close to each other to
        determine the filter, or the order is out of range.
    """
    result = _convert(_checked_lsf(lsf), lsf_to_reflection_each_into)
    if not np.isfinite(result).all():
        raise InputError("lsf: frequencies are too close to each other to tell the filter")
    return result


def lsf_to_ar(lsf: FloatArray) -> FloatArray:
    """Return the filter coefficients of line spectral frequencies.

    The error is about 1e-14 of the largest coefficient at order 64.

    Raises
    ------
    InputError
        The frequencies do not ascend strictly inside (0, pi), or the order is out of range.
    """
    return _convert(_checked_lsf(lsf), lsf_to_ar_each_into)


def output_power(variance: float | FloatArray, reflection: FloatArray) -> FloatArray:
    """Return the mean square of the output, ``variance / prod(1 - k^2)``.

    Parameters
    ----------
    variance : () or (n,)
        Variance of the excitation.
    reflection : (m,) or (n, m)
        Each of magnitude below one.

    Raises
    ------
    InputError
        A coefficient's magnitude is not below one, or the order is out of range.
    """
    k = _checked_reflection(reflection)
    power: FloatArray = np.asarray(variance) / np.prod((1.0 - k) * (1.0 + k), axis=-1)
    return power


def lsf_output_power(variance: FloatArray, lsf: FloatArray) -> FloatArray:
    """Return `output_power` (n,) of line spectral frequencies (n, m), much faster.

    It is finite, though huge, where two frequencies have merged.

    Raises
    ------
    InputError
        The frequencies do not ascend strictly inside (0, pi), or the order is out of range.
    """
    gain = np.empty(len(lsf))
    lsf_inverse_gain_each_into(_checked_lsf(lsf), gain)
    return np.asarray(variance / np.maximum(gain, TINY))


def _convert(
    values: FloatArray, convert_rows: Callable[[FloatArray, FloatArray], None]
) -> FloatArray:
    result = np.empty_like(values)
    convert_rows(np.atleast_2d(values), np.atleast_2d(result))
    return result


def _checked(name: str, values: FloatArray) -> FloatArray:
    array = np.require(real_numbers(name, values), requirements=["C", "W"])  # for compiled code
    if array.ndim not in {1, 2} or not 1 <= array.shape[-1] <= LARGEST_ORDER:
        raise InputError(
            f"{name} has shape {array.shape}: (m,) or (n, m) with m from 1 to {LARGEST_ORDER}"
            " is allowed"
        )
    if not np.isfinite(array).all():
        raise InputError(f"{name} has a value that is not finite")
    return array


def _checked_reflection(reflection: FloatArray) -> FloatArray:
    array = _checked("reflection", reflection)
    if (np.abs(array) >= 1.0).any():
        raise InputError("reflection: a magnitude is not below 1, so the filter is not stable")
    return array


def _checked_lsf(lsf: FloatArray) -> FloatArray:
    array = _checked("lsf", lsf)
    if not are_lsf(np.atleast_2d(array)):
        raise InputError("lsf must ascend strictly inside (0, pi)")
    return array


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
