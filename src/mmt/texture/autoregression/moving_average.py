"""All-pole approximations of filters with zeros.

A filter ``gain * C(z) / A(z)`` driven by white noise has an autocorrelation that follows from
its coefficients without a transform; Levinson's recursion turns it into the all-pole filter of
any order that predicts the same signal best (Markel and Gray, "Linear prediction of speech",
1976, ch. 5). The higher the order, the nearer its spectrum; zeros near the unit circle take
many poles.
"""

from typing import NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import ar_to_reflection, reflection_to_ar
from mmt.texture.autoregression.order_limit import LARGEST_ORDER
from mmt.texture.autoregression.reshaping import levinson

_CLOSE_DB = 0.1
_FLOOR_DB = 60.0
"""Spectra are compared down to this far below their maximum: at zeros they fall without bound."""
_TRANSFORM = 2048


class AllPole(NamedTuple):
    """All-pole filters of one order that approximate others.

    ``reflection`` (n, order), ``variance`` (n,) of the excitation, and ``error_db`` (n,): the
    root mean square over frequency of the difference between the spectra in dB.
    """

    reflection: FloatArray
    variance: FloatArray
    error_db: FloatArray


def autocorrelation(ar: FloatArray, ma: FloatArray, lags: int) -> FloatArray:
    """Return lags 0 ... `lags` of the output of ``C(z) / A(z)`` for white noise of variance 1.

    Parameters
    ----------
    ar
        a[0] ... a[p-1] of ``A(z) = 1 + sum a[j] z^-(j+1)``, stable.
    ma
        c[0] ... c[q] of ``C(z)``.
    lags
        The last one, at least 0. Cost: O(p (p + q + lags)).

    Raises
    ------
    InputError
        The filter is not stable, or as `mmt.texture.autoregression.forms.ar_to_reflection`.
    """
    reach = lags + len(ma) - 1
    of_poles = _pole_autocorrelation(np.asarray(ar, dtype=np.float64), reach)
    both_sides = np.concatenate([of_poles[:0:-1], of_poles])
    of_zeros = np.correlate(ma, ma, mode="full")
    whole = np.convolve(both_sides, of_zeros)
    middle = len(whole) // 2
    return np.asarray(whole[middle : middle + lags + 1])


def all_pole(ar: FloatArray, ma: FloatArray, variance: FloatArray) -> AllPole:
    """Return all-pole filters of one order whose spectra are near those of filters with zeros.

    The order is the least, from that of the poles up to 64, at which no spectrum differs by
    more than 0.1 dB, root mean square over frequency; where there is none, 64.

    Parameters
    ----------
    ar
        Shape (n, p), as of `autocorrelation`.
    ma
        Shape (n, q + 1).
    variance
        Variance of the excitation, shape (n,).

    Raises
    ------
    InputError
        A filter is not stable.
    """
    filters = list(zip(ar, ma, strict=True))
    lags = np.array([autocorrelation(a, c, LARGEST_ORDER) for a, c in filters])
    predictors = levinson(lags)
    errors = lags[:, :1] * np.cumprod((1.0 - predictors) * (1.0 + predictors), axis=1)
    wanted = [_level_db(np.append(1.0, a), c) for a, c in filters]
    for order in range(ar.shape[1], LARGEST_ORDER + 1):
        error = np.array(
            [
                _difference_db(reflection[:order], left[order - 1], level)
                for reflection, left, level in zip(predictors, errors, wanted, strict=True)
            ]
        )
        if error.max() <= _CLOSE_DB or order == LARGEST_ORDER:
            break
    return AllPole(predictors[:, :order], errors[:, order - 1] * variance, error)


def _pole_autocorrelation(ar: FloatArray, lags: int) -> FloatArray:
    """Return lags 0 ... `lags` of the output of ``1 / A(z)``, by Levinson's recursion turned."""
    reflection = ar_to_reflection(ar)
    lag = np.zeros(max(lags, len(ar)) + 1)
    error = lag[0] = 1.0 / float(np.prod((1.0 - reflection) * (1.0 + reflection)))
    lower = np.zeros(0)
    for m, k in enumerate(reflection, start=1):
        lag[m] = -k * error - lower @ lag[m - 1 : 0 : -1]
        error *= (1.0 - k) * (1.0 + k)
        lower = np.append(lower + k * lower[::-1], k)
    for m in range(len(ar) + 1, lags + 1):
        lag[m] = -ar @ lag[m - len(ar) : m][::-1]
    return lag[: lags + 1]


def _difference_db(reflection: FloatArray, variance: float, wanted_db: FloatArray) -> float:
    poles = np.append(1.0, reflection_to_ar(reflection))
    found_db = _level_db(poles, np.array([np.sqrt(variance)]))
    floor_db = wanted_db.max() - _FLOOR_DB
    difference = np.maximum(found_db, floor_db) - np.maximum(wanted_db, floor_db)
    return float(np.sqrt(np.mean(difference**2)))


def _level_db(ar: FloatArray, ma: FloatArray) -> FloatArray:
    """Return the level of ``C(z) / A(z)``, both from their coefficient of order 0, in dB."""
    with np.errstate(divide="ignore"):
        level: FloatArray = 20.0 * (np.log10(_magnitude(ma)) - np.log10(_magnitude(ar)))
    return level


def _magnitude(coefficients: FloatArray) -> FloatArray:
    """Return the magnitude at evenly spaced angles from 0 to pi."""
    magnitude: FloatArray = np.abs(np.fft.rfft(coefficients, _TRANSFORM))
    return magnitude
