"""Symmetric matrices made tridiagonal, for many systems that differ by a multiple of the identity.

``C = Q T Q'`` by Householder reflections (Golub and Van Loan, Matrix Computations, 2013, algorithm
8.3.1), so that ``C + s I = Q (T + s I) Q'`` takes O(k) for each right-hand side and shift s, by the
factors L D L' of the tridiagonal matrix. It must be positive definite.

Eigenvectors take longer, and LAPACK's start the threads of BLAS, whose waiting doubles the
processor time of an update; see `mmt.texture.linear_algebra`. The innermost loops go over slices
from 0 on: with another bound, indices are tested for negative values, which prevents vectorisation.
"""

from typing import NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel


class ShiftedSystems(NamedTuple):
    """``(C + s I) x = y`` for a symmetric matrix C (k, k) and any right-hand sides y (k, m)."""

    reflectors: FloatArray
    """Those of Q, (k, k)."""
    diagonal: FloatArray
    """Diagonal of T, (k,)."""
    beside: FloatArray
    """The diagonal beside it, (k - 1,)."""
    rotated: FloatArray
    """``Q' y``, (k, m)."""

    def squares(self, shifts: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``y' inverse(C + s I) y`` (s, m), and the logarithms of the determinants (s,)."""
        return squares_of(self.diagonal, self.beside, self.rotated, shifts)

    def solutions(self, shifts: FloatArray) -> FloatArray:
        """Return ``inverse(C + s I) y`` (k, m), each column with its own shift s (m,)."""
        solved = self.rotated.copy()
        solve_in_place(self.diagonal, self.beside, shifts, solved)
        turn_in_place(self.reflectors, solved, True)
        return solved


def shifted_systems(matrix: FloatArray, rows: FloatArray) -> ShiftedSystems:
    """Make a symmetric matrix (k, k), k > 0, tridiagonal, for right-hand sides (k, m)."""
    reflectors, rotated = (np.array(each, np.float64, order="C") for each in (matrix, rows))
    diagonal, beside = reduce_in_place(reflectors)
    turn_in_place(reflectors, rotated, False)
    return ShiftedSystems(reflectors, diagonal, beside, rotated)


@kernel("UniTuple(f8[::1], 2)(f8[:, ::1])")
def reduce_in_place(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Make a symmetric matrix (k, k) tridiagonal; return the diagonal (k,) and the one beside it.

    Row i receives the vector v of length sqrt(2), from column i + 1 on, of the reflection I - v v'.
    """
    size = len(matrix)
    diagonal, beside, products = np.empty(size), np.zeros(max(size - 1, 0)), np.empty(size)
    for i in range(size):
        diagonal[i] = matrix[i, i]
        v, product, square = matrix[i, i + 1 :], products[i + 1 :], 0.0
        for j in range(len(v)):
            square += v[j] ** 2
        if square == 0.0:
            continue
        length = np.sqrt(square)
        beside[i] = -length if v[0] > 0.0 else length
        v[0] -= beside[i]
        scale = 1.0 / np.sqrt(length * abs(v[0]))
        for j in range(len(v)):
            v[j] *= scale
            product[j] = 0.0
        for k in range(len(v)):
            row, weight = matrix[i + 1 + k, i + 1 :], v[k]
            for j in range(len(v)):
                product[j] += weight * row[j]
        half = 0.0
        for j in range(len(v)):
            half += 0.5 * v[j] * product[j]
        for j in range(len(v)):
            product[j] -= half * v[j]
        for k in range(len(v)):
            row, weight, other = matrix[i + 1 + k, i + 1 :], v[k], product[k]
            for j in range(len(v)):
                row[j] -= weight * product[j] + other * v[j]
    return diagonal, beside


@kernel("void(f8[:, ::1], f8[:, ::1], b1)")
def turn_in_place(reflectors: FloatArray, rows: FloatArray, back: bool) -> None:
    """Multiply rows (k, m) by Q', or by Q with ``back``, in place."""
    size, along = len(rows), np.empty(rows.shape[1])
    for step in range(size - 1):
        i = size - 2 - step if back else step
        for m in range(len(along)):
            along[m] = 0.0
        for j in range(i + 1, size):
            row, weight = rows[j], reflectors[i, j]
            for m in range(len(along)):
                along[m] += weight * row[m]
        for j in range(i + 1, size):
            row, weight = rows[j], reflectors[i, j]
            for m in range(len(along)):
                row[m] -= weight * along[m]


@kernel("void(f8[::1], f8[::1], f8[::1], f8[:, ::1])")
def solve_in_place(
    diagonal: FloatArray, beside: FloatArray, shifts: FloatArray, rows: FloatArray
) -> None:
    """Solve ``(T + s I) x = y`` for each column of rows (k, m), with its own shift s (m,)."""
    pivots = np.empty(rows.shape)
    for i in range(len(rows)):
        row, pivot = rows[i], pivots[i]
        for m in range(len(shifts)):
            pivot[m] = diagonal[i] + shifts[m]
        if i > 0:
            above, pivot_above, side = rows[i - 1], pivots[i - 1], beside[i - 1]
            for m in range(len(shifts)):
                ratio = side / pivot_above[m]
                pivot[m] -= ratio * side
                row[m] -= ratio * above[m]
    for i in range(len(rows) - 1, -1, -1):
        row, pivot = rows[i], pivots[i]
        if i < len(rows) - 1:
            below, side = rows[i + 1], beside[i]
            for m in range(len(shifts)):
                row[m] -= side * below[m]
        for m in range(len(shifts)):
            row[m] /= pivot[m]


@kernel("Tuple((f8[:, ::1], f8[::1]))(f8[::1], f8[::1], f8[:, ::1], f8[::1])")
def squares_of(
    diagonal: FloatArray, beside: FloatArray, rotated: FloatArray, shifts: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the results of `ShiftedSystems.squares`."""
    squares, logarithms = np.zeros((len(shifts), rotated.shape[1])), np.zeros(len(shifts))
    rest = np.zeros(rotated.shape[1])
    for s in range(len(shifts)):
        pivot, square = 1.0, squares[s]
        for i in range(len(diagonal)):
            before, row = beside[i - 1] if i else 0.0, rotated[i]
            ratio = before / pivot
            pivot = diagonal[i] + shifts[s] - ratio * before
            logarithms[s] += np.log(pivot)
            for m in range(len(rest)):
                rest[m] = row[m] - ratio * rest[m]
                square[m] += rest[m] ** 2 / pivot
    return squares, logarithms
