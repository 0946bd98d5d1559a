"""The linear system of a radial basis function network, solved once for all outputs.

``[[K + D, G], [G^T, 0]] [w; d] = [y; 0]``, K the radial functions between the centres, D the
smoothing, G the polynomials. Householder reflections that send G to its first columns leave
the positive definite block H of K + D on the weights that are orthogonal to polynomials; its
Cholesky factor gives the inverse of the whole. Cost: n^3 multiplications for the inverse, n^2
for all else.

Polynomials that the centres cannot tell apart (fewer centres than polynomials, centres on a
line or a plane) are dropped: G holds an orthonormal basis of the values that polynomials take
at the centres, of rank r. That changes nothing in the constraint on the weights, so that H is
positive definite whatever the centres are, and the polynomial is the least one that fits.

Updates of an inverse in place cost O(n^2) and keep it exactly symmetric; their arrays are larger
than the system, and `size` says how much of them counts.
"""

from dataclasses import dataclass
from math import comb
from typing import Final

import numpy as np
from scipy.linalg import lapack, qr

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.interpolation.radial_basis.functions import (
    monomials,
    polynomial_matrix_into,
    radial_matrix_into,
)
from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings

REFINABLE: Final = 1e-4
"""Largest relative error of an inverse that one step of refinement leaves at 1e-8."""

LEAST_RECIPROCAL_CONDITION: Final = 100.0 * float(np.finfo(np.float64).eps) / REFINABLE
"""An inverse errs by its condition times a few roundings; below this, H is smoothed."""

INDISPENSABLE: Final = 1e-10
"""A centre whose pivot in the inverse, times the system's norm, is no more than this is the
only one to tell some polynomial: its weight is zero, and nothing can be said without it."""

SAME_PLANE: Final = 1e-6
"""A combination of polynomials whose values (n,) are smaller than this is dropped."""


@dataclass(frozen=True)
class PolynomialBasis:
    """Polynomials orthonormal on a set of centres.

    Attributes
    ----------
    degree
        The highest that the number of centres allows.
    exponents
        Exponents of the monomials, shape (k, d).
    transform
        From monomials to the basis, shape (k, r), r at most k.
    """

    degree: int
    exponents: IntArray
    transform: FloatArray

    @property
    def rank(self) -> int:
        """How many polynomials the centres can tell apart."""
        return int(self.transform.shape[1])

    def misses(self, row: FloatArray) -> bool:
        """Say whether monomials (k,) at a point hold what no centre has shown yet."""
        if self.rank == len(self.exponents):
            return False
        span, _ = np.linalg.qr(self.transform)
        return bool(np.linalg.norm(row - span @ (span.T @ row)) > SAME_PLANE)


@dataclass(frozen=True)
class Solved:
    """A system and its inverse, polynomials first; shapes (r + n, r + n).

    ``added_smoothing`` is what stands on the diagonal beyond the settings' own, ``scale`` the
    largest column sum of H, ``least`` the eigenvalue below which H counts as singular.
    """

    basis: PolynomialBasis
    matrix: FloatArray
    inverse: FloatArray
    added_smoothing: float
    scale: float
    least: float


def usable_degree(count: int, dimensions: int, settings: RadialBasisSettings) -> int:
    """Return the highest degree not above the wanted one with no more polynomials than centres.

    Never below the kernel's least degree, without which H need not be positive definite.
    """
    degree = settings.highest_degree
    while degree > settings.function.least_degree and comb(dimensions + degree, degree) > count:
        degree -= 1
    return degree


def polynomial_basis(
    points: FloatArray, settings: RadialBasisSettings
) -> tuple[PolynomialBasis, FloatArray]:
    """Return the polynomials orthonormal on points (n, d), and their values (n, r) there."""
    degree = usable_degree(len(points), points.shape[1], settings)
    exponents = monomials(points.shape[1], degree)
    values = np.empty((len(points), len(exponents)))
    polynomial_matrix_into(exponents, points, values)
    left, singular, right = np.linalg.svd(values, full_matrices=False)
    kept = singular > SAME_PLANE
    transform = right[kept].T / singular[kept]
    return PolynomialBasis(degree, exponents, transform), np.ascontiguousarray(left[:, kept])


class Complement:
    """The orthogonal complement of r orthonormal columns (n, r), by Householder reflections.

    Their product is kept as ``Q = I - V T V^T`` (Schreiber and Van Loan, "A storage-efficient
    WY representation for products of Householder transformations", SIAM J. Sci. Stat. Comput.
    10 (1989), 53-57), so that turning a matrix costs O(n^2 r).
    """

    def __init__(self, columns: FloatArray) -> None:
        count, self.rank = columns.shape
        (reflectors, tau), _ = qr(columns, mode="raw") if self.rank else ((columns, []), None)
        self._v = np.tril(reflectors, -1) + np.eye(count, self.rank)
        self._t = np.zeros((self.rank, self.rank))
        for i, factor in enumerate(tau):
            self._t[:i, i] = -factor * (self._t[:i, :i] @ (self._v[:, :i].T @ self._v[:, i]))
            self._t[i, i] = factor

    def reduce(self, matrix: FloatArray) -> FloatArray:
        """Return the block (n - r, n - r) of a symmetric matrix (n, n) on the complement."""
        return self._turned(matrix, self._t)[self.rank :, self.rank :]

    def expand(self, block: FloatArray) -> FloatArray:
        """Return the symmetric matrix (n, n) of a block on the complement, zero elsewhere."""
        return self._turned(np.pad(block, ((self.rank, 0), (self.rank, 0))), self._t.T)

    def raise_columns(self, columns: FloatArray) -> FloatArray:
        """Return columns (n, c) of coordinates (n - r, c) in the complement."""
        padded = np.pad(columns, ((self.rank, 0), (0, 0)))
        raised: FloatArray = padded - self._v @ (self._t @ (self._v.T @ padded))
        return raised

    def _turned(self, matrix: FloatArray, t: FloatArray) -> FloatArray:
        """Return ``(I - V T V^T)^T matrix (I - V T V^T)``, exactly symmetric."""
        right = matrix @ (self._v @ t)
        right -= 0.5 * (self._v @ (t.T @ (self._v.T @ right)))
        half = self._v @ right.T
        turned: FloatArray = matrix - (half + half.T)
        return turned


def smoothed_matrix(
    points: FloatArray, counts: FloatArray, settings: RadialBasisSettings
) -> FloatArray:
    """Return K + D (n, n) of centres (n, d), each with a number of samples (n,)."""
    matrix = np.empty((len(points), len(points)))
    radial_matrix_into(settings.function.number, settings.epsilon, points, matrix)
    matrix[np.diag_indices_from(matrix)] += settings.smoothing / counts
    return matrix


def solve(points: FloatArray, counts: FloatArray, settings: RadialBasisSettings) -> Solved:
    """Build the system of centres (n, d), each with a number of samples (n,), and invert it.

    Where H is too close to singular for its inverse to be worth anything (flat functions,
    centres all but coincident), as much smoothing is added as gives it twice the least
    eigenvalue, so that there is room for further centres. Beside what H itself calls for, that
    is what the rounding of K calls for: of flat functions, all but constant, little is left in H.
    """
    basis, polynomials = polynomial_basis(points, settings)
    radial = smoothed_matrix(points, counts, settings)
    complement = Complement(polynomials)
    block = complement.reduce(radial)
    scale = float(np.abs(block).sum(axis=0).max(initial=0.0))
    rounding = float(np.finfo(np.float64).eps * np.abs(radial).sum(axis=0).max())
    least = max(LEAST_RECIPROCAL_CONDITION * scale, rounding / REFINABLE)
    inverted, added = _invert(block, scale, least), 0.0
    if inverted is None:
        added = 2.0 * least
        radial[np.diag_indices_from(radial)] += added
        inverted = _cholesky_inverse(_cholesky(complement.reduce(radial)))
    upper = complement.expand(inverted)
    side = polynomials - upper @ (radial @ polynomials)
    corner = -(polynomials.T @ (radial @ side))
    zero = np.zeros_like(corner)
    return Solved(
        basis,
        np.block([[zero, polynomials.T], [polynomials, radial]]),
        np.block([[0.5 * (corner + corner.T), side.T], [side, upper]]),
        added,
        scale,
        least,
    )


def _invert(block: FloatArray, scale: float, least: float) -> FloatArray | None:
    """Return the inverse of a positive definite block, None where it is all but singular."""
    if not len(block):
        return np.zeros((0, 0))
    factor = _cholesky(block)
    if factor is None:
        return None
    reciprocal, _ = lapack.dpocon(factor, scale, uplo="L")
    return None if reciprocal * scale < least else _cholesky_inverse(factor)


def _cholesky(block: FloatArray) -> FloatArray | None:
    factor, failed = lapack.dpotrf(block, lower=1, clean=1)
    return None if failed else np.asarray(factor)


def _cholesky_inverse(factor: FloatArray | None) -> FloatArray:
    if factor is None:
        message = "a smoothed block of a positive definite kernel is positive definite"
        raise ArithmeticError(message)
    inverse, _ = lapack.dpotri(factor, lower=1)
    lower = np.tril(inverse)
    return np.asarray(lower + np.tril(lower, -1).T)


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
        The inverse of the first `size` rows; one more is added in place.
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
