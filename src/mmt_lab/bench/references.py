"""Reference results for errors: textbook definitions in arithmetic of many digits.

Pure Python with mpmath. Nothing is arranged for speed or numerical stability: the references may
be slow, and the digits make up for lost accuracy.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import mpmath
import numpy as np

from mmt.core.arrays import FloatArray
from mmt_lab.stability.families.ar import exact_burg

DIGITS: Final = 120

Number = Any
"""A number of mpmath, whose types have no public names."""


def exact(values: FloatArray | Sequence[float]) -> list[Number]:
    """Return numbers without rounding."""
    return [mpmath.mpf(float(value)) for value in values]


def burg(x: FloatArray, order: int) -> list[Number]:
    """Return Burg's reflection coefficients of orders 1 to `order`.

    If a signal is predicted completely, such as one of zeros, the remaining ones are zero.
    """
    with mpmath.workdps(DIGITS):
        return [mpmath.mpf(str(k)) for k in exact_burg(x, order)[0]]


def residual(x: FloatArray, ar: Sequence[Number]) -> Number:
    """Return the mean square of a signal's forward and backward prediction errors."""
    with mpmath.workdps(DIGITS):
        values, taps = exact(x), [mpmath.mpf(1), *ar]
        order = len(ar)
        total = mpmath.mpf(0)
        for start in range(len(values) - order):
            window = values[start : start + order + 1]
            forward = mpmath.fdot(taps, window[::-1])
            backward = mpmath.fdot(taps, window)
            total += forward * forward + backward * backward
        return total / (2 * (len(values) - order))


def step_up(reflection: Sequence[Number]) -> list[Number]:
    """Return the filter coefficients, without the leading 1, of reflection coefficients."""
    with mpmath.workdps(DIGITS):
        ar: list[Number] = []
        for k in reflection:
            ar = [left + k * right for left, right in zip(ar, ar[::-1], strict=True)] + [k]
        return ar


def step_down(ar: Sequence[Number]) -> list[Number] | None:
    """Return the reflection coefficients, or None if one has magnitude one."""
    with mpmath.workdps(DIGITS):
        rest = list(ar)
        reflection = []
        while rest:
            k = rest[-1]
            if abs(k) == 1:
                return None
            reflection.append(k)
            count = len(rest) - 1
            rest = [(rest[j] - k * rest[count - 1 - j]) / (1 - k * k) for j in range(count)]
        return reflection[::-1]


def is_stable(ar: FloatArray) -> bool:
    """Return whether a filter with exactly these coefficients has its poles in the unit circle."""
    if not np.isfinite(ar).all():
        return False
    reflection = step_down(exact(ar))
    return reflection is not None and all(abs(k) < 1 for k in reflection)


def lsf_to_ar(lsf: FloatArray) -> list[Number]:
    """Return the filter coefficients of line spectral frequencies, from their definition."""
    with mpmath.workdps(DIGITS):
        p = q = np.array([mpmath.mpf(1)])
        for index, frequency in enumerate(exact(lsf)):
            factor = [mpmath.mpf(1), -2 * mpmath.cos(frequency), mpmath.mpf(1)]
            if index % 2 == 0:
                p = np.convolve(p, factor)
            else:
                q = np.convolve(q, factor)
        if len(lsf) % 2 == 0:
            p, q = np.convolve(p, exact([1, 1])), np.convolve(q, exact([1, -1]))
        else:
            q = np.convolve(q, exact([1, 0, -1]))
        return [(a + b) / 2 for a, b in zip(p, q, strict=True)][1 : len(lsf) + 1]


def refine_lsf(ar: Sequence[Number], start: FloatArray) -> list[Number] | None:
    """Return the line spectral frequencies of a filter, by the secant method from `start` (m,).

    The result is always complete: m different zeros inside (0, pi), which are all the zeros. None
    if the start does not lead to that.
    """
    with mpmath.workdps(DIGITS):
        order = len(ar)
        taps = [mpmath.mpf(1), *ar, mpmath.mpf(0)]
        found = []
        for index, begin in enumerate(exact(start)):
            zero = _zero(taps, begin, 1 if index % 2 == 0 else -1)
            if zero is None or not 0 < zero < mpmath.pi:
                return None
            found.append(zero)
        gaps = [b - a for a, b in pairwise(found)]
        least = mpmath.mpf(10) ** (10 - DIGITS // 2)
        return found if len(found) == order and all(gap > least for gap in gaps) else None


def _zero(taps: list[Number], begin: Number, sign: int) -> Number | None:
    """Return a zero near `begin` of A(w) + sign * (its reversal), without its phase, or None."""
    whole = [a + sign * b for a, b in zip(taps, taps[::-1], strict=True)]
    # The palindrome (or its negative) is a sum of cosines (sines) about its middle.
    wave, half = mpmath.cos if sign > 0 else mpmath.sin, mpmath.mpf(len(taps) - 1) / 2
    places = [half - j for j in range(len(taps))]
    try:
        return mpmath.findroot(
            lambda w: mpmath.fdot(whole, [wave(place * w) for place in places]),
            (begin, begin * (1 + mpmath.mpf(10) ** -12)),
            tol=mpmath.mpf(10) ** (-DIGITS // 2),
        )
    except (ValueError, ZeroDivisionError):  # it does not converge, or the slope vanishes
        return None


def largest_error(found: FloatArray, expected: Sequence[Number]) -> float:
    """Return the largest absolute error; infinity if `found` is not finite or differs in length."""
    if not np.isfinite(found).all() or len(found) != len(expected):
        return float("inf")
    with mpmath.workdps(DIGITS):
        return float(max(abs(a - b) for a, b in zip(exact(found), expected, strict=True)))
