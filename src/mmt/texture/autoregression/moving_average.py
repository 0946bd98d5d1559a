"""All-pole approximations of filters with zeros.

The all-pole filter of an order that predicts a signal best has the first autocorrelations of the
signal's spectrum (`mmt.texture.autoregression.reshaping`). A higher order brings its own spectrum
nearer to that; zeros near the unit circle take many poles.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.autoregression.forms import reflection_to_ar
from mmt.texture.autoregression.reshaping import reflection_of

_CLOSE_DB: Final = 0.1
_FLOOR_DB: Final = 60.0
"""Depth below their maximum to which spectra are compared: at zeros they fall without bound."""
_TRANSFORM: Final = 2**15
"""Samples after which autocorrelations repeat: those of the sharpest lines have decayed."""


class AllPole(NamedTuple):
    """All-pole filters of one order that approximate others.

    ``reflection`` (n, order), ``variance`` (n,) of the excitation, and ``error_db`` (n,): the
    root mean square over frequency of the difference between the spectra in dB.
    """

    reflection: FloatArray
    variance: FloatArray
    error_db: FloatArray


def all_pole(ar: FloatArray, ma: FloatArray, variance: FloatArray) -> AllPole:
    """Return all-pole filters of one order whose spectra are near those of filters with zeros.

    The order is the least, from that of the poles up to 64, at which no spectrum differs by
    more than 0.1 dB, root mean square over frequency; if there is none, 64.

    Parameters
    ----------
    ar
        a[0] ... a[p-1] of ``A(z) = 1 + sum a[j] z^-(j+1)``, stable, shape (n, p).
    ma
        c[0] ... c[q] of ``C(z)``, shape (n, q + 1).
    variance
        Variance of the excitation, shape (n,).
    """
    wanted = _square(ma) / _square(np.insert(ar, 0, 1.0, axis=1))
    reflection, power = reflection_of(2.0 * wanted, LARGEST_ORDER)
    left = power[:, None] * np.cumprod((1.0 - reflection) * (1.0 + reflection), axis=1)
    for order in range(ar.shape[1], LARGEST_ORDER + 1):
        poles = reflection_to_ar(reflection[:, :order])
        found = left[:, order - 1 : order] / _square(np.insert(poles, 0, 1.0, axis=1))
        error_db = _difference_db(found, wanted)
        if error_db.max() <= _CLOSE_DB:
            break
    return AllPole(reflection[:, :order], left[:, order - 1] * variance, error_db)


def _square(coefficients: FloatArray) -> FloatArray:
    """Return squared magnitudes (n, f) at even angles from 0 to pi."""
    return np.asarray(np.square(np.abs(np.fft.rfft(coefficients, _TRANSFORM, axis=1))))


def _difference_db(found: FloatArray, wanted: FloatArray) -> FloatArray:
    floor = wanted.max(axis=1, keepdims=True) * 10.0 ** (-_FLOOR_DB / 10.0)
    ratio = np.maximum(found, floor) / np.maximum(wanted, floor)
    return np.asarray(np.sqrt(np.mean(np.square(10.0 * np.log10(ratio)), axis=1)))
