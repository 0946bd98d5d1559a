"""What a segment's own samples say of a knock: bursts that its neighbours do not explain.

A knock is short. The segment is led through the prediction error filter of its neighbours'
consensus, which makes of the texture white noise and leaves of the knock a burst, and the ringing
of what was struck. The largest of either is compared with what the rest of the segment has, so
that a wrong level of the consensus does no harm, and with what the consensus expects.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from mmt.arrays import FloatArray
from mmt.compiled import kernel
from mmt.texture.selection.points import band
from mmt.texture.selection.ringing import loudest_ring, modes

SHORT: Final = 16
LONG: Final = 32
SHORTEST: Final = 64
"""Samples of prediction error from which a burst can be told from the rest."""


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


@kernel("void(f8[::1], f8[::1], f8[::1])")
def _residual(x: FloatArray, ar: FloatArray, error: FloatArray) -> None:
    for n in range(error.size):
        total = x[n + ar.size]
        for j in range(ar.size):
            total += ar[j] * x[n + ar.size - 1 - j]
        error[n] = total


@kernel("void(f8[::1], i8, f8[::1])")
def _means(squares: FloatArray, width: int, means: FloatArray) -> None:
    """Write the means over every window; every one is summed anew, so that none drifts."""
    for n in range(means.size):
        total = 0.0
        for j in range(width):
            total += squares[n + j]
        means[n] = total / width


def bursts(segments: Sequence[FloatArray], filters: Whitening) -> FloatArray:
    """Return the logarithms of four ratios for each segment, shape (n, 4).

    The loudest `SHORT` samples of the prediction error over the median such stretch; the
    loudest `LONG` over the variance that was expected; the energy that the loudest damped tone
    explains (see `mmt.texture.selection.ringing`) over the same, and over what the rest of the
    segment has. Zero where a segment is too short to tell.
    """
    result = np.zeros((len(segments), 4))
    tiny = np.finfo(np.float64).tiny
    grid = modes()
    for index, segment in enumerate(segments):
        x = np.ascontiguousarray(segment, dtype=np.float64)
        error = np.empty(max(0, len(x) - filters.ar.shape[1]))
        if len(error) < SHORTEST:
            continue
        ar = np.ascontiguousarray(filters.ar[index])
        _residual(x, ar, error)
        squares = error * error
        short = np.empty(len(error) - SHORT + 1)
        long = np.empty(len(error) - LONG + 1)
        _means(squares, SHORT, short)
        _means(squares, LONG, long)
        ring = loudest_ring(error, ar, grid)
        rest = max(float(squares.sum()) - ring, 0.0) / len(error)
        expected = max(filters.variance[index], tiny)
        result[index] = np.log(
            [
                max(short.max(), tiny) / max(np.median(short), tiny),
                max(long.max(), tiny) / expected,
                max(ring, tiny) / expected,
                max(ring, tiny) / max(rest, tiny),
            ]
        )
    return result
