"""Kernels on qd arrays: eigenvalues from the array, and the array from nodes and masses.

The array ``q[0], e[0], q[1], e[1], ...`` of positive numbers is the matrix ``B B^T``, B
bidiagonal with the square roots of `q` on the diagonal and of `e` beside it (Rutishauser
1954; Fernando and Parlett, "Accurate singular values and differential qd algorithms", Numer.
Math. 67 (1994), 191-229). In both directions the only subtractions are shifts that stay below
the smallest eigenvalue, so that every result is accurate relative to itself. Cost: O(size^2).
"""

import math
from typing import Final

import numpy as np

from mmt.arrays import FloatArray
from mmt.compiled import kernel

_EPSILON: Final = float(np.finfo(np.float64).eps)
_NEGLIGIBLE: Final = _EPSILON * _EPSILON
_BELOW: Final = 1.0 - 2.0**-44  # of a bound, so that its rounding never makes it too large
_MOST_STEPS: Final = 40
_STRETCH: Final = 8  # so many factors, each above 1e-32, stay within the range of numbers


@kernel("f8(f8, f8, i8)")
def _laguerre(trace: float, square: float, size: int) -> float:
    """Return Laguerre's lower bound of the smallest eigenvalue.

    From the traces of the inverse and of its square; it converges cubically (von Matt, "The
    orthogonal qd-algorithm", SIAM J. Sci. Comput. 18 (1997), 1163-1186).
    """
    if not square < np.inf:
        return _BELOW / trace
    spread = (size - 1) * max(0.0, size * square - trace * trace)
    return _BELOW * size / (trace + math.sqrt(spread))


@kernel("UniTuple(f8, 4)(f8[::1], f8[::1], f8, f8[::1])")
def _shift(
    q: FloatArray, e: FloatArray, shift: float, work: FloatArray
) -> tuple[float, float, float, float]:
    """Take one dqds step; return the traces of the inverse and of its square after it.

    First those without the last row, then those of all; the latter are -1, and there was no
    step, if it went too far. The last `e`, beyond the last `q`, is taken in: it becomes zero.
    The difference d of the algorithm is carried as a ratio, so that no division waits for
    another. An `e` that is negligible for every eigenvalue's relative accuracy becomes zero
    (the criterion of Demmel and Kahan, 1990). `work` is (2 * size,).
    """
    size = len(q)
    new_q, new_e = work[:size], work[size : 2 * size]
    numerator, denominator = q[0] - shift, 1.0
    beside = column = mixed = trace = square = 0.0
    for begin in range(0, size - 1, _STRETCH):
        for i in range(begin, min(begin + _STRETCH, size - 1)):
            if not numerator >= 0.0:
                return 0.0, 0.0, -1.0, -1.0
            following = q[i + 1]
            product = numerator + e[i] * denominator
            inverse = denominator / product
            new_q[i] = product / denominator
            numerator = following * numerator - shift * product
            denominator = product
            share = beside * inverse
            mixed = share * (mixed + column * column)
            column = inverse + share * column
            trace += column
            square += column * column + 2.0 * mixed
            beside = e[i] * following * inverse
            new_e[i] = beside if beside * column > _NEGLIGIBLE else 0.0
        numerator /= denominator
        denominator = 1.0
    last = numerator + e[size - 1]
    if not last >= 0.0:
        return 0.0, 0.0, -1.0, -1.0
    for i in range(size - 1):
        q[i] = new_q[i]
        e[i] = new_e[i]
    q[size - 1] = last
    e[size - 1] = 0.0
    share = beside / last
    mixed = share * (mixed + column * column)
    column = 1.0 / last + share * column
    return trace, square, trace + column, square + column * column + 2.0 * mixed


@kernel("void(f8[::1], f8[::1])")
def _turn(q: FloatArray, e: FloatArray) -> None:
    """Reverse a block whose small end is at the front: convergence is at the back."""
    size = len(q)
    for i in range(size // 2):
        q[i], q[size - 1 - i] = q[size - 1 - i], q[i]
    for i in range((size - 1) // 2):
        e[i], e[size - 2 - i] = e[size - 2 - i], e[i]


@kernel("i8(f8[::1], i8, f8)")
def _insert(values: FloatArray, found: int, value: float) -> int:
    """Put a value into the first `found` ascending ones; return how many there are now."""
    place = found
    while place > 0 and values[place - 1] > value:
        values[place] = values[place - 1]
        place -= 1
    values[place] = value
    return found + 1


@kernel("i8(f8[::1], f8[::1], i8, f8, f8[::1], f8[::1])")
def eigenvalues_up_to(
    q: FloatArray, e: FloatArray, size: int, bound: float, values: FloatArray, work: FloatArray
) -> int:
    """Write the eigenvalues up to `bound`, ascending, into `values` (size,); return how many.

    Parameters
    ----------
    q, e : (size,)
        The array, overwritten. The last `e`, beyond the last `q`, may be zero; a positive one
        stands for a further column of B, and does not add an eigenvalue.
    size
        Of the array, below that of `q` and `e` where these are longer.
    bound
        Eigenvalues above it are not looked for.
    values : (size,)
        Receives the result.
    work : (3 * size,) or longer
        Scratch.

    Notes
    -----
    A block without a zero among its `e` has one common shift. Its last `q` is given up once
    neither it nor the coupling to the rows before, ``q e`` over the distance to their
    eigenvalues, can change an eigenvalue by a rounding; its `e` stays as the further column.
    """
    totals = work[2 * size : 3 * size]
    totals[:] = 0.0
    found = 0
    steps_left = _MOST_STEPS * size
    shift = trace = square = 0.0
    while size > 0:
        start = size - 1
        while start > 0 and e[start - 1] > 0.0:
            start -= 1
        total = totals[size - 1]
        if total + shift > bound:
            size, shift = start, 0.0
            continue
        last, alone = q[size - 1], start == size - 1
        value = total + last + (e[size - 1] if alone else 0.0)
        least = 0.125 * _EPSILON * value
        others, done = 0.0, alone or steps_left == 0
        if not done and last <= least and e[size - 1] == 0.0:
            others = _laguerre(trace, square, size - 1 - start)
            done = last * e[size - 2] <= least * others
        if done:
            size, shift = size - 1, others
            if value <= bound:
                found = _insert(values, found, value)
            continue
        steps_left -= 1
        if e[size - 1] == 0.0 and 1.5 * q[start] < last:
            _turn(q[start:size], e[start:size])
        trace, square, whole, whole_square = _shift(q[start:size], e[start:size], shift, work)
        if whole < 0.0:
            shift = 0.5 * shift if shift > _EPSILON * total else 0.0
            continue
        for i in range(start, size):
            totals[i] = total + shift
        shift = _laguerre(whole, whole_square, size - start)
    return found


@kernel("void(f8[::1], f8[::1], i8, f8)")
def move_origin(q: FloatArray, e: FloatArray, size: int, distance: float) -> None:
    """Move all nodes up by `distance`: the stationary qd step with a positive shift."""
    t = distance
    for i in range(size):
        old = q[i]
        q[i] = old + t
        if i + 1 < size:
            share = e[i] / q[i]
            e[i] = share * old
            t = distance + share * t


@kernel("void(f8[::1], f8[::1], i8, f8, f8)")
def add_mass(q: FloatArray, e: FloatArray, size: int, mass: float, added: float) -> None:
    """Add a node of mass `added` at zero to nodes of total `mass`; the size grows by one."""
    d = q[0] * (added / (mass + added))
    q[0] *= mass / (mass + added)
    for i in range(size - 1):
        beside = d + e[i]
        following = q[i + 1] / beside
        q[i + 1] = following * e[i]
        d *= following
        e[i] = beside
    e[size - 1] = d
    q[size] = 0.0
