"""Evidence of knocks in a segment's own samples: bursts that its neighbours do not predict.

A knock is short. The segment is filtered by the prediction error filter that its neighbours
predict, which whitens the texture and leaves a burst of the knock, and the ringing of the struck
object. The largest of either is compared with the rest of the segment, so that an error of the
predicted level does no harm, and with the predicted level.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Self

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.selection.damped_tones import ComplexArray, loudest_tone_energy, modes
from mmt.texture.selection.points import band

SHORT: Final = 16
LONG: Final = 32
SHORTEST: Final = 64
"""Least samples of prediction error from which bursts are computed."""

_TINY: Final = float(np.finfo(np.float64).tiny)


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
    ar = np.zeros((len(density), order))
    error = np.full(len(density), 1.0 + 1e-9)  # a floor 90 dB down keeps it definite
    for m in range(order):
        inner = np.einsum("nj,nj->n", ar[:, :m], correlation[:, m:0:-1])
        k = -(correlation[:, m + 1] + inner) / error
        ar[:, :m] += k[:, None] * ar[:, :m][:, ::-1].copy()
        ar[:, m] = k
        error *= np.maximum(1.0 - k * k, 1e-12)
    return Whitening(ar, 0.5 * error * scale[:, 0])


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


@kernel("f8[::1](f8[::1], i8)")
def _means(squares: FloatArray, width: int) -> FloatArray:
    """Return the means over every window; every one is summed anew, so that none drifts."""
    means = np.empty(squares.size - width + 1)
    for n in range(means.size):
        total = 0.0
        for j in range(width):
            total += squares[n + j]
        means[n] = total / width
    return means


@kernel("void(f8[::1], i8[::1], f8[:, ::1], f8[::1], c16[::1], f8[:, ::1])")
def _bursts(
    samples: FloatArray,
    starts: IntArray,
    ar: FloatArray,
    variance: FloatArray,
    grid: ComplexArray,
    result: FloatArray,
) -> None:
    """Write the rows that `bursts` returns."""
    for row in range(variance.size):
        error = prediction_error(samples[starts[row] : starts[row + 1]], ar[row])
        if error.size < SHORTEST:
            continue
        squares = error * error
        short, long = _means(squares, SHORT), _means(squares, LONG)
        ring = loudest_tone_energy(error, ar[row], grid)
        rest = max(squares.sum() - ring, 0.0) / error.size
        expected = max(variance[row], _TINY)
        result[row, 0] = math.log(max(short.max(), _TINY) / max(np.median(short), _TINY))
        result[row, 1] = math.log(max(long.max(), _TINY) / expected)
        result[row, 2] = math.log(max(ring, _TINY) / expected)
        result[row, 3] = math.log(max(ring, _TINY) / max(rest, _TINY))


def bursts(segments: Sequence[FloatArray], filters: Whitening) -> FloatArray:
    """Return the logarithms of four ratios for each segment, shape (n, 4).

    The loudest `SHORT` samples of the prediction error over the median such stretch; the
    loudest `LONG` over the variance that was expected; the energy that the loudest damped tone
    explains (see `mmt.texture.selection.damped_tones`) over the same, and over what the rest of the
    segment has. Zero where a segment is too short to tell.
    """
    result = np.zeros((len(segments), 4))
    packed = Packed.of(segments)
    ar = np.ascontiguousarray(filters.ar)
    variance = np.ascontiguousarray(filters.variance)
    _bursts(packed.samples, packed.starts, ar, variance, modes(), result)
    return result
