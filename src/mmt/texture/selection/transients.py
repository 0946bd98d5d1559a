"""Evidence of knocks in a segment's own samples: something struck that rings.

The segment is filtered by the prediction error filter that the other points predict, which whitens
the texture and leaves the knock. What is asked is how much likelier the samples are with one damped
tone (`mmt.texture.selection.damped_tones`) than without.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple, Self

import numpy as np
from scipy.special import wrightomega

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.forms import reflection_to_ar
from mmt.texture.autoregression.reshaping import levinson
from mmt.texture.selection.damped_tones import ComplexArray, loudest_tone_energy, modes
from mmt.texture.selection.points import band

SHORTEST: Final = 64
"""Least samples of prediction error in which a tone is looked for."""

_TINY: Final = float(np.finfo(np.float64).tiny)
_LARGEST: Final = 1e100  # times the energy that was expected: more makes no difference
_LARGEST_SHARE: Final = 1.0 - 1e-9  # of the energy, that a tone explains


class Whitening(NamedTuple):
    """Prediction error filters: ``ar`` (n, m) without the leading 1, ``variance`` (n,)."""

    ar: FloatArray
    variance: FloatArray


def whitening(density: FloatArray, order: int) -> Whitening:
    """Return the prediction error filters of power spectra (n, f) at `band`.

    Levinson's recursion on their autocorrelations, all at once; O(n (f order + order^2)).
    """
    lags = np.cos(2.0 * np.pi * np.outer(band(density.shape[1]), np.arange(order + 1)))
    correlation = density @ lags / density.shape[1]
    scale = correlation[:, :1].copy()
    correlation /= scale
    correlation[:, 0] += 1e-9  # a floor 90 dB down keeps it definite
    reflection = levinson(correlation)
    error = correlation[:, 0] * np.prod(1.0 - np.square(reflection), axis=1)
    return Whitening(reflection_to_ar(reflection), 0.5 * error * scale[:, 0])


class Packed(NamedTuple):
    """Segments one behind the other: ``samples``, and where each begins, (n + 1,)."""

    samples: FloatArray
    starts: IntArray

    @classmethod
    def of(cls, segments: Sequence[FloatArray]) -> Self:
        """Pack segments."""
        starts = np.zeros(len(segments) + 1, dtype=np.int64)
        starts[1:] = np.cumsum([len(segment) for segment in segments])
        samples = np.concatenate([np.zeros(0), *segments])
        return cls(np.ascontiguousarray(samples, dtype=np.float64), starts)


@kernel("f8[::1](f8[::1], f8[::1])")
def prediction_error(x: FloatArray, ar: FloatArray) -> FloatArray:
    """Return the prediction error of a segment by a filter without its leading 1.

    It has the segment's length less the filter's order, none where that is not above zero.
    """
    error = np.empty(max(0, x.size - ar.size))
    for n in range(error.size):
        total = x[n + ar.size]
        for j in range(ar.size):
            total += ar[j] * x[n + ar.size - 1 - j]
        error[n] = total
    return error


@kernel("void(f8[::1], i8[::1], f8[:, ::1], f8[::1], c16[::1], f8[:, ::1])")
def _energies(
    samples: FloatArray,
    starts: IntArray,
    ar: FloatArray,
    variance: FloatArray,
    grid: ComplexArray,
    result: FloatArray,
) -> None:
    """Write the length of each prediction error, its energy, and the loudest tone's share."""
    for row in range(variance.size):
        error = prediction_error(samples[starts[row] : starts[row + 1]], ar[row])
        if error.size < SHORTEST:
            continue
        energy = max((error * error).sum(), _TINY)
        result[row, 0] = error.size
        result[row, 1] = min(energy / max(variance[row], _TINY), _LARGEST)
        result[row, 2] = min(loudest_tone_energy(error, ar[row], grid) / energy, _LARGEST_SHARE)


def tone_evidence(
    segments: Sequence[FloatArray], filters: Whitening, level_variance: FloatArray
) -> FloatArray:
    """Return how much likelier segments are with the likeliest damped tone, in nepers, (n,).

    Parameters
    ----------
    segments
        Vibration.
    filters
        Predicted ones.
    level_variance
        Variance of the logarithm of the predicted excitation's variance, positive, shape (n,).

    Notes
    -----
    The level is unknown within its predicted error, with the tone and without: each likelihood is
    that of the likeliest level. Of more instants the largest is larger, by the logarithm of their
    number (Gumbel), which is subtracted. Zero where a segment is too short to tell.
    """
    found = np.zeros((len(segments), 3))
    packed = Packed.of(segments)
    ar, variance = np.ascontiguousarray(filters.ar), np.ascontiguousarray(filters.variance)
    _energies(packed.samples, packed.starts, ar, variance, modes(), found)
    count, energy, share = found.T
    rest = (1.0 - share) * energy
    gain = _surprise(energy, count, level_variance) - _surprise(rest, count, level_variance)
    return np.where(count > 0.0, gain - np.log(np.maximum(count, 1.0)), 0.0)


def _surprise(energy: FloatArray, count: FloatArray, variance: FloatArray) -> FloatArray:
    """Return minus the log likelihood of white noise at the likeliest level, but for a constant.

    The least over s, a normal offset of the level, of
    ``count / 2 s + energy / 2 exp(-s) + s^2 / (2 variance)``, which is where
    ``s = omega(ln(variance energy / 2) + variance count / 2) - variance count / 2``, by Wright's
    omega function (Corless and Jeffrey, "The Wright omega function", 2002). There the derivative is
    zero, and ``energy exp(-s)`` is ``count + 2 s / variance``.
    """
    expected = 0.5 * variance * count
    s = wrightomega(np.log(np.maximum(0.5 * variance * energy, _TINY)) + expected) - expected
    return np.asarray(0.5 * (count * (s + 1.0) + s * (s + 2.0) / variance))
