"""Reflection coefficients of segments by Burg's method, and of given spectra by Levinson's.

Burg, "Maximum entropy spectral analysis", thesis, Stanford 1975. Three choices keep the recursion
accurate on every finite signal, where common forms fail (near-unit-circle poles, offsets, extreme
amplitudes):

- the denominator is summed anew at every order, never carried on by a recursion;
- the signal is scaled by a power of two first, which is exact;
- the reflection coefficient and its complement come from the sums of squares of f+b and f-b,
  ``k = (D - S) / (D + S)`` and ``1 - k^2 = 4 D S / (D + S)^2``: nothing cancels, so that the
  residual variance keeps its digits when k is within roundings of one.

Cost: about 8 operations a sample and order.

The filter of order p with the first p + 1 autocorrelations of a spectrum is the best of its order
in the sense of linear prediction (Markel and Gray, Linear Prediction of Speech, 1976, section
3.3). It follows by Levinson's recursion and is stable, as autocorrelations are positive definite.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.bounds import check, real_numbers
from mmt.core.compiled import kernel
from mmt.core.errors import InputError
from mmt.texture.autoregression import TINY, Order

LARGEST_REFLECTION: Final = 1.0 - 2.0**-53
"""The largest number below one, the bound of |k|."""

_VANISHED: Final = 2.0**-100
_LARGEST: Final = float(np.finfo(np.float64).max)


class ReflectionFits(NamedTuple):
    """A model fitted to one segment, or models fitted to s segments.

    ``reflection`` (m,) or (s, m); ``variances`` (m + 1,) or (s, m + 1): the mean squares of the
    residuals of orders 0 ... m.
    """

    reflection: FloatArray
    variances: FloatArray

    @property
    def variance(self) -> FloatArray:
        """Variance of the excitation of each, () or (s,): the residual of the full order."""
        return np.asarray(self.variances[..., -1])

    @property
    def power(self) -> FloatArray:
        """Mean square of each segment, () or (s,), which is that of the model's output."""
        return np.asarray(self.variances[..., 0])


def burg(x: FloatArray, order: int) -> ReflectionFits:
    """Fit an autoregressive model by Burg's method.

    The mean is not removed. The fit is stable for every finite signal: each ``|k| < 1``, the
    variances finite and not negative. A signal that is predicted to its last digit (zero,
    constant, a pure tone) ends the recursion: further reflection coefficients are zero.
    Amplitudes from denormal to 1e300 give the same reflection coefficients; variances are
    limited to the largest floating-point number.

    Parameters
    ----------
    x : (n,)
        The segment, n greater than `order`.
    order
        From 1 to 64.

    Raises
    ------
    InputError
        A sample is not finite, the order is out of range, or the segment is too short.
    """
    fits = burg_batch([x], order)
    return ReflectionFits(fits.reflection[0], fits.variances[0])


def burg_batch(segments: Sequence[FloatArray] | FloatArray, order: int) -> ReflectionFits:
    """Fit an autoregressive model to each segment, as `burg` does.

    Parameters
    ----------
    segments
        Arrays of equal or different lengths, or the rows of an array (s, n).
    order
        From 1 to 64.

    Raises
    ------
    InputError
        As `burg`; the message names the segment.
    """
    check("order", order, Order)
    arrays = [real_numbers(f"segment {k}", segment) for k, segment in enumerate(segments)]
    for index, array in enumerate(arrays):
        if array.ndim != 1 or len(array) <= order:
            raise InputError(
                f"segment {index} has shape {array.shape}: order {order} needs one row of more than"
                f" {order} samples"
            )
    reflection = np.empty((len(arrays), order))
    variances = np.empty((len(arrays), order + 1))
    if arrays:
        stops = np.cumsum([len(array) for array in arrays], dtype=np.int64)
        fitted = burg_each_into(np.concatenate(arrays), stops, reflection, variances)
        if fitted < len(arrays):
            raise InputError(f"segment {fitted} has a sample that is not finite: leave it out")
    return ReflectionFits(reflection, variances)


@kernel("f8(f8[::1])", inner=True)
def largest_magnitude(values: FloatArray) -> float:
    """Return the largest magnitude, infinity if a value is not a number."""
    largest = 0.0
    for value in values:
        if not abs(value) <= np.inf:
            return float(np.inf)
        largest = max(largest, abs(value))
    return largest


@kernel("void(f8[::1], i8, f8[::1])", inner=True)
def _scale(x: FloatArray, exponent: int, scaled: FloatArray) -> None:
    """Write x times 2^-exponent, in two factors: one alone would overflow for denormal numbers."""
    half = exponent // 2
    first, second = math.ldexp(1.0, -half), math.ldexp(1.0, half - exponent)
    for i in range(len(x)):
        scaled[i] = x[i] * first * second


@kernel("UniTuple(f8, 2)(f8[::1], f8[::1])")
def _sums(forward: FloatArray, backward: FloatArray) -> tuple[float, float]:
    """Return the sums of (f+b)^2 and (f-b)^2."""
    plus, minus = 0.0, 0.0
    for i in range(len(forward)):
        f, b = forward[i], backward[i]
        plus += (f + b) * (f + b)
        minus += (f - b) * (f - b)
    return plus, minus


@kernel("void(f8[::1], f8[::1], f8, f8)", inner=True)
def _predict(forward: FloatArray, backward: FloatArray, plus: float, minus: float) -> None:
    """Replace f, b by f + k b, b + k f, given 1 + k and 1 - k.

    Written around f-b or f+b, whichever is nearly exact when k is near -1 or 1.
    """
    if plus < minus:
        for i in range(len(forward)):
            f, b = forward[i], backward[i]
            forward[i] = (f - b) + plus * b
            backward[i] = (b - f) + plus * f
        return
    for i in range(len(forward)):
        f, b = forward[i], backward[i]
        forward[i] = (f + b) - minus * b
        backward[i] = (b + f) - minus * f


@kernel("b1(f8[::1], f8[::1], f8[::1], f8[::1])", inner=True)
def burg_into(
    x: FloatArray, reflection: FloatArray, variances: FloatArray, work: FloatArray
) -> bool:
    """Write the reflection coefficients (m,) and variances (m + 1,) that `burg` gives for x (n,).

    The residual has vanished at 2^-100 of the signal's power. Returns False, with nothing written,
    if a sample is not finite. `work` is scratch, (2 n,) or longer.
    """
    n = len(x)
    forward, backward = work[:n], work[n : 2 * n]
    largest = largest_magnitude(x)
    if not largest < np.inf:
        return False
    exponent = math.frexp(largest)[1]
    _scale(x, exponent, forward)
    for i in range(n):  # copying slices takes the compiler a second and a half
        backward[i] = forward[i]
    variance = 0.25 * _sums(forward, backward)[0] / n
    vanished = _VANISHED * variance
    variances[0] = min(math.ldexp(variance, 2 * exponent), _LARGEST)
    reflection[:] = 0.0
    for order in range(1, len(reflection) + 1):
        variances[order] = variances[order - 1]
        if variance <= vanished:
            continue
        ahead, behind = forward[order:], backward[: n - order]
        sum_square, difference_square = _sums(ahead, behind)
        total = sum_square + difference_square
        if total == 0.0:
            vanished = variance
            continue
        plus, minus = 2.0 * (difference_square / total), 2.0 * (sum_square / total)
        k = (difference_square - sum_square) / total
        reflection[order - 1] = min(max(k, -LARGEST_REFLECTION), LARGEST_REFLECTION)
        variance *= min(1.0, plus * minus)
        variances[order] = min(math.ldexp(variance, 2 * exponent), _LARGEST)
        _predict(ahead, behind, plus, minus)
    return True


@kernel("i8(f8[::1], i8[::1], f8[:, ::1], f8[:, ::1])")
def burg_each_into(
    joined: FloatArray, stops: IntArray, reflection: FloatArray, variances: FloatArray
) -> int:
    """Fit segments that are concatenated in `joined`, each up to its stop (s,).

    `reflection` (s, m) and `variances` (s, m + 1) receive a row for each, see `burg_into`.
    Returns the number of segments fitted: all, or the index of the first that is not finite.
    """
    longest, start = 0, 0
    for stop in stops:
        longest = max(longest, stop - start)
        start = stop
    work = np.empty(2 * longest)
    start = 0
    for row in range(len(stops)):
        if not burg_into(joined[start : stops[row]], reflection[row], variances[row], work):
            return row
        start = stops[row]
    return len(stops)


LARGEST_OF_SPECTRA: Final = 1.0 - 1e-9
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

    The first column is positive. Once no more than rounding is left to predict, the remaining
    coefficients are zero; all stay within `LARGEST_OF_SPECTRA`.
    """
    count, order = autocorrelation.shape[0], autocorrelation.shape[1] - 1
    reflection, error = np.zeros((count, order)), autocorrelation[:, 0].copy()
    coefficients = np.zeros((count, order + 1))
    coefficients[:, 0] = 1.0
    rounding = 1e-13 * error
    for stage in range(order):
        backwards = autocorrelation[:, stage + 1 : 0 : -1]
        k = -np.einsum("ij,ij->i", coefficients[:, : stage + 1], backwards) / error
        k = np.clip(k, -LARGEST_OF_SPECTRA, LARGEST_OF_SPECTRA) * (error > rounding)
        coefficients[:, 1 : stage + 2] += k[:, None] * coefficients[:, stage::-1][:, : stage + 1]
        reflection[:, stage] = k
        error *= 1.0 - np.square(k)
    return reflection
