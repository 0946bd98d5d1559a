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
_MOST_STEPS: Final = 40


@kernel("f8(f8[::1], f8[::1], i8, i8)")
def _shift_below(q: FloatArray, e: FloatArray, start: int, stop: int) -> float:
    """Return Laguerre's lower bound of the smallest eigenvalue; write zeros into negligible e.

    From the traces of the inverse and of its square; it converges cubically (von Matt, "The
    orthogonal qd-algorithm", SIAM J. Sci. Comput. 18 (1997), 1163-1186). The criterion of
    Demmel and Kahan (1990) says what is negligible for every eigenvalue's relative accuracy.
    """
    column = 1.0 / q[start]
    mixed = 0.0
    trace = column
    square = column * column
    for i in range(start + 1, stop):
        if e[i - 1] * column <= _NEGLIGIBLE:
            e[i - 1] = 0.0
        inverse = 1.0 / q[i]
        share = e[i - 1] * inverse
        mixed = share * (mixed + column * column)
        column = inverse + share * column
        trace += column
        square += column * column + 2.0 * mixed
    if not square < np.inf:
        return float(1.0 / trace)
    size = stop - start
    spread = (size - 1) * max(0.0, size * (square / trace / trace) - 1.0)
    return float(size / (trace * (1.0 + math.sqrt(spread))))


@kernel("b1(f8[::1], f8[::1], i8, i8, f8, f8[::1])")
def _shift(
    q: FloatArray, e: FloatArray, start: int, stop: int, shift: float, work: FloatArray
) -> bool:
    """Take one dqds step; False, and no step, if it went too far."""
    d = q[start] - shift
    for i in range(start, stop - 1):
        if not d >= 0.0:
            return False
        work[2 * i] = d + e[i]
        following = q[i + 1] / work[2 * i]
        work[2 * i + 1] = e[i] * following
        d = d * following - shift
    if not d >= 0.0:
        return False
    for i in range(start, stop - 1):
        q[i] = work[2 * i]
        e[i] = work[2 * i + 1]
    q[stop - 1] = d
    return True


@kernel("void(f8[::1], f8[::1], i8, i8)")
def _turn(q: FloatArray, e: FloatArray, start: int, stop: int) -> None:
    """Reverse the block if its small end is at the front: convergence is at the back."""
    if 1.5 * q[start] > q[stop - 1]:
        return
    size = stop - start
    for i in range(size // 2):
        left, right = start + i, stop - 1 - i
        q[left], q[right] = q[right], q[left]
    for i in range((size - 1) // 2):
        left, right = start + i, stop - 2 - i
        e[left], e[right] = e[right], e[left]


@kernel("f8(f8[::1], f8[::1], i8, i8, f8, f8[::1])")
def _improve(
    q: FloatArray, e: FloatArray, start: int, stop: int, total: float, work: FloatArray
) -> float:
    """Move a block closer to its smallest eigenvalue; return by how much it was shifted."""
    _turn(q, e, start, stop)
    shift = _shift_below(q, e, start, stop)
    while not _shift(q, e, start, stop, shift, work):  # only rounding makes the bound too large
        if shift == 0.0:
            e[stop - 2] = 0.0
            break
        shift = 0.5 * shift if shift > _EPSILON * total else 0.0
    return shift


@kernel("i8(f8[::1], f8[::1], i8, f8, f8[::1], f8[::1])")
def eigenvalues_up_to(
    q: FloatArray, e: FloatArray, size: int, bound: float, values: FloatArray, work: FloatArray
) -> int:
    """Write the eigenvalues up to `bound`, ascending, into `values` (size,); return how many.

    All arrays are overwritten; `work` is (3 * size,). A block of the array without a zero
    among its `e` has one common shift.
    """
    totals = 2 * size
    work[totals : totals + size] = 0.0
    found = 0
    steps_left = _MOST_STEPS * size
    while size > 0:
        start = size - 1
        while start > 0 and e[start - 1] > 0.0:
            start -= 1
        total = work[totals + size - 1]
        value = total + q[size - 1]
        if total > bound:
            size = start
        elif start == size - 1 or e[size - 2] <= _NEGLIGIBLE * value or steps_left == 0:
            size -= 1
            if value <= bound:
                place = found
                while place > 0 and values[place - 1] > value:
                    values[place] = values[place - 1]
                    place -= 1
                values[place] = value
                found += 1
        else:
            steps_left -= 1
            total += _improve(q, e, start, size, total, work)
            for i in range(start, size):
                work[totals + i] = total
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
