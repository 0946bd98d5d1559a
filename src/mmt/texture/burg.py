"""Burg's method, stable and accurate on every finite signal.

Burg, "Maximum entropy spectral analysis", thesis, Stanford 1975. Three choices make it hold
where common forms fail (near-unit-circle poles, offsets, extreme amplitudes):

- the denominator is summed anew at every order, never carried on by a recursion;
- the signal is scaled by a power of two first, which is exact;
- the reflection coefficient and its complement come from the sums of squares of f+b and f-b,
  ``k = (D - S) / (D + S)`` and ``1 - k^2 = 4 D S / (D + S)^2``: nothing cancels, so that the
  residual variance keeps its digits when k is within roundings of one.

Cost: about 8 operations a sample and order.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.arrays import FloatArray, IntArray
from mmt.compiled import kernel
from mmt.errors import InputError
from mmt.texture.settings import LARGEST_ORDER

LARGEST_REFLECTION: Final = 1.0 - 2.0**-53
"""The largest number below one: what |k| is held at."""

_VANISHED: Final = 2.0**-100
_LARGEST: Final = float(np.finfo(np.float64).max)


@dataclass(frozen=True)
class ReflectionFit:
    """A model fitted to one segment.

    ``reflection`` (m,); ``variances`` (m + 1,): the mean square of what the models of order
    0 ... m leave of the segment.
    """

    reflection: FloatArray
    variances: FloatArray

    @property
    def variance(self) -> float:
        """Variance of the excitation: the residual of the full order."""
        return float(self.variances[-1])

    @property
    def power(self) -> float:
        """Mean square of the segment, which is that of the model's output."""
        return float(self.variances[0])


@dataclass(frozen=True)
class ReflectionFits:
    """Models fitted to s segments: ``reflection`` (s, m), ``variances`` (s, m + 1)."""

    reflection: FloatArray
    variances: FloatArray

    @property
    def variance(self) -> FloatArray:
        """Variance of the excitation of each, (s,)."""
        return self.variances[:, -1]

    @property
    def power(self) -> FloatArray:
        """Mean square of each segment, (s,)."""
        return self.variances[:, 0]


def burg(x: FloatArray, order: int) -> ReflectionFit:
    """Fit an autoregressive model by Burg's method.

    The mean is not removed. The fit is stable for every finite signal: each ``|k| < 1``, the
    variances finite and not negative. A signal that is predicted to its last digit (zero,
    constant, a pure tone) ends the recursion: further reflection coefficients are zero.
    Amplitudes from denormal to 1e300 give the same reflection coefficients; a variance that
    is too large for a number is held at the largest one.

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
    return ReflectionFit(fits.reflection[0], fits.variances[0])


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
    if not 1 <= order <= LARGEST_ORDER:
        raise InputError(f"order {order}: from 1 to {LARGEST_ORDER} is allowed")
    arrays = [np.asarray(segment, dtype=np.float64) for segment in segments]
    for index, array in enumerate(arrays):
        if array.ndim != 1 or len(array) <= order:
            raise InputError(
                f"segment {index} has shape {array.shape}: order {order} needs one row of more"
                f" than {order} samples"
            )
        if not np.isfinite(array).all():
            raise InputError(f"segment {index} has a sample that is not finite: leave it out")
    reflection = np.empty((len(arrays), order))
    variances = np.empty((len(arrays), order + 1))
    if arrays:
        stops = np.cumsum([len(array) for array in arrays], dtype=np.int64)
        burg_each_into(np.concatenate(arrays), stops, reflection, variances)
    return ReflectionFits(reflection, variances)


@kernel("i8(f8[::1], f8[::1])")
def _scale(x: FloatArray, scaled: FloatArray) -> int:
    """Write x times a power of two, the largest magnitude within [0.5, 1); return the power.

    In two factors, since one alone would overflow for denormal numbers.
    """
    largest = 0.0
    for value in x:
        largest = max(largest, abs(value))
    exponent = math.frexp(largest)[1]
    half = exponent // 2
    first, second = math.ldexp(1.0, -half), math.ldexp(1.0, half - exponent)
    for i in range(len(x)):
        scaled[i] = x[i] * first * second
    return exponent


@kernel("UniTuple(f8, 2)(f8[::1], f8[::1])")
def _sums(forward: FloatArray, backward: FloatArray) -> tuple[float, float]:
    """Return the sums of (f+b)^2 and (f-b)^2, each from four interleaved partial sums."""
    s0 = s1 = s2 = s3 = d0 = d1 = d2 = d3 = 0.0
    count = len(forward)
    whole = count - count % 4
    for i in range(0, whole, 4):
        s0 += (forward[i] + backward[i]) ** 2
        s1 += (forward[i + 1] + backward[i + 1]) ** 2
        s2 += (forward[i + 2] + backward[i + 2]) ** 2
        s3 += (forward[i + 3] + backward[i + 3]) ** 2
        d0 += (forward[i] - backward[i]) ** 2
        d1 += (forward[i + 1] - backward[i + 1]) ** 2
        d2 += (forward[i + 2] - backward[i + 2]) ** 2
        d3 += (forward[i + 3] - backward[i + 3]) ** 2
    for i in range(whole, count):
        s0 += (forward[i] + backward[i]) ** 2
        d0 += (forward[i] - backward[i]) ** 2
    return (s0 + s1) + (s2 + s3), (d0 + d1) + (d2 + d3)


@kernel("void(f8[::1], f8[::1], f8, f8)")
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


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1])")
def burg_into(
    x: FloatArray, reflection: FloatArray, variances: FloatArray, work: FloatArray
) -> None:
    """Write the reflection coefficients (m,) and the residual variances of orders 0 ... m.

    Parameters
    ----------
    x : (n,)
        Finite, not checked; n > m.
    reflection : (m,)
        Receives numbers of magnitude below one. Where the residual has vanished to the
        rounding of the signal itself (2^-100 of its power), the remaining ones are zero.
    variances : (m + 1,)
        Receives the mean square of x and what each order leaves of it; what is too large for
        a number is held at the largest one.
    work : (2 * n,) or longer
        Scratch.
    """
    n = len(x)
    forward, backward = work[:n], work[n : 2 * n]
    exponent = _scale(x, forward)
    variance = 0.0
    for i in range(n):
        backward[i] = forward[i]
        variance += forward[i] * forward[i]
    variance /= n
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


@kernel("void(f8[::1], i8[::1], f8[:, ::1], f8[:, ::1])")
def burg_each_into(
    joined: FloatArray, stops: IntArray, reflection: FloatArray, variances: FloatArray
) -> None:
    """Fit segments that lie one behind the other in `joined`, each up to its stop (s,).

    `reflection` (s, m) and `variances` (s, m + 1) receive a row for each, see `burg_into`.
    """
    longest, start = 0, 0
    for stop in stops:
        longest = max(longest, stop - start)
        start = stop
    work = np.empty(2 * longest)
    start = 0
    for row in range(len(stops)):
        burg_into(joined[start : stops[row]], reflection[row], variances[row], work)
        start = stops[row]
