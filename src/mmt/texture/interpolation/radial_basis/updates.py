"""Updates of a symmetric matrix's inverse in place: a row and column more, less, or changed.

All cost O(n^2) and keep the matrix exactly symmetric. The arrays are larger than the system;
`size` says how much of them counts.
"""

from mmt.core.arrays import FloatArray
from mmt.core.compiled import kernel


@kernel("void(f8[:, ::1], i8, f8[::1], f8)")
def add_outer(matrix: FloatArray, size: int, column: FloatArray, factor: float) -> None:
    """Add ``factor column column^T`` to the first `size` rows and columns."""
    for i in range(size):
        for j in range(size):
            matrix[i, j] += factor * (column[i] * column[j])


@kernel("void(f8[:, ::1], i8, f8[::1], f8)")
def border_inverse(inverse: FloatArray, size: int, solved: FloatArray, schur: float) -> None:
    """Turn A^-1 into the inverse of ``[[A, a], [a^T, c]]``.

    Parameters
    ----------
    inverse
        Of `size` rows; gets one more.
    solved : (size,)
        ``A^-1 a``.
    schur
        ``c - a^T A^-1 a``, not zero.
    """
    factor = 1.0 / schur
    add_outer(inverse, size, solved, factor)
    for i in range(size):
        inverse[i, size] = -factor * solved[i]
        inverse[size, i] = -factor * solved[i]
    inverse[size, size] = factor


@kernel("void(f8[:, ::1], i8, f8[::1], f8)")
def border_matrix(matrix: FloatArray, size: int, column: FloatArray, corner: float) -> None:
    """Write a further row and column (size,) and their corner."""
    for i in range(size):
        matrix[i, size] = column[i]
        matrix[size, i] = column[i]
    matrix[size, size] = corner


@kernel("void(f8[:, ::1], i8, i8, i8)")
def move_last(matrix: FloatArray, size: int, place: int, last: int) -> None:
    """Let the row and column `last` take the place of another; `last` is ``size - 1``."""
    for i in range(size):
        matrix[place, i] = matrix[last, i]
    for i in range(size):
        matrix[i, place] = matrix[i, last]
    matrix[place, place] = matrix[last, last]
