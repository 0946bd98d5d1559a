"""Radial basis function network through samples, and the terms of its leave-one-out errors.

``f(u) = sum_j w_j phi(|u - q_j|) + d_0 + sum_k d_k u_k`` (Abdulali and Jeon, "Data-Driven Rendering
of Anisotropic Haptic Textures", 2016, eq. 1). The paper names neither the radial function nor the
polynomial. Here phi is the thin plate spline ``r^2 log r``, the smoothest in a plane, which has no
shape parameter to choose, with the polynomial of degree 1 that it needs (Fasshauer, "Meshfree
Approximation Methods with MATLAB", 2007, chapter 8).

The weights are orthogonal to the polynomials; in that subspace the matrix K of radial functions is
positive definite. With U an orthonormal basis of the polynomials' values at the samples,
``(I - U U^T) K (I - U U^T) + s U U^T`` is positive definite in the whole space, and one Cholesky
factor solves for all outputs. Polynomials that the samples cannot tell apart (fewer samples than
polynomials, samples on a line or a plane) are not in U.

Cost: n^3 / 3 multiplications; n^3 with the inverse, which the errors take.
"""

from contextlib import suppress
from functools import cached_property
from typing import Final

import numpy as np
from scipy.linalg import lapack
from scipy.spatial.distance import cdist

from mmt.core.arrays import FloatArray
from mmt.texture.linear_algebra import cholesky, product, solve_backward, solve_forward

SAME_PLANE: Final = 1e-6
"""A combination of polynomials whose values (n,) are smaller than this is dropped."""

_REFINABLE: Final = 1e-4
"""Largest relative error of a solution that one step of refinement reduces to 1e-8."""

_EPS: Final = float(np.finfo(np.float64).eps)
_LEAST_RECIPROCAL_CONDITION: Final = 100.0 * _EPS / _REFINABLE
_INDISPENSABLE: Final = 1e-10
"""Bound on a sample's pivot in the inverse, times the system's norm. At or below it, the sample
alone determines some polynomial, and its leave-one-out error is not defined."""


class RadialBasisNetwork:
    """The network through samples.

    If samples nearly coincide, the system is nearly singular. Its diagonal is then raised to give
    twice the least eigenvalue that can be refined, which smooths the samples.

    Parameters
    ----------
    points, values
        At least one sample, shapes (n, d) and (n, m), finite.
    smoothing
        Number that ridge regression adds to the diagonal, not negative; 0 fits every sample.

    Attributes
    ----------
    weights, coefficients
        Of the radial functions, (n, m), and of the polynomial, (1 + d, m), constant first.
    """

    def __init__(self, points: FloatArray, values: FloatArray, smoothing: float = 0.0) -> None:
        self.points = points
        polynomials = _polynomials(points)
        basis, singular, right = np.linalg.svd(polynomials, full_matrices=False)
        kept = singular > SAME_PLANE
        self._basis: FloatArray = np.ascontiguousarray(basis[:, kept])
        radial = _radial(points, points)
        radial[np.diag_indices_from(radial)] += smoothing
        projected = self._off(self._off(radial).T)
        self._scale = max(float(np.abs(projected).sum(axis=0).max()), np.finfo(np.float64).tiny)
        rounding = _EPS * float(np.abs(radial).sum(axis=0).max()) / _REFINABLE
        self._factor, added = self._factored(projected, rounding)
        radial[np.diag_indices_from(radial)] += added
        self.weights = np.zeros_like(values)
        for _ in range(2):  # the second time refines
            left = self._off(values - product(radial, self.weights))
            solved = solve_backward(self._factor, solve_forward(self._factor, left.T))
            self.weights += self._off(solved.T)
        rest = product(self._basis.T, values - product(radial, self.weights))
        self.coefficients = np.asarray((right[kept].T / singular[kept]) @ rest)

    def at(self, queries: FloatArray) -> FloatArray:
        """Return the outputs (q, m) at points (q, d)."""
        radial = _radial(queries, self.points) @ self.weights
        return np.asarray(radial + _polynomials(queries) @ self.coefficients)

    @cached_property
    def inverse(self) -> FloatArray:
        """The block of the system's inverse that gives the weights from the values, (n, n)."""
        root = solve_forward(self._factor, np.eye(len(self.points)))
        return self._off(self._off(product(root, np.ascontiguousarray(root.T))).T)

    def is_indispensable(self, pivot: float) -> bool:
        """Return whether a sample with this diagonal element of `inverse` cannot be left out.

        For all other samples, the error of the network without the sample is its weight over its
        pivot (Rippa, "An algorithm for selecting a good value for the parameter c in radial basis
        function interpolation", Adv. Comput. Math. 11 (1999), 193-210).
        """
        return pivot * self._scale <= _INDISPENSABLE

    def _off(self, columns: FloatArray) -> FloatArray:
        """Return the part of columns (n, k) that is orthogonal to the polynomials."""
        inside = product(self._basis.T, np.ascontiguousarray(columns))
        return np.asarray(columns - product(self._basis, inside))

    def _factored(self, projected: FloatArray, rounding: float) -> tuple[FloatArray, float]:
        """Return the Cholesky factor, and the number added to the diagonal for it."""
        basis = np.ascontiguousarray(self._basis.T)
        system = projected + self._scale * product(self._basis, basis)
        least = max(_LEAST_RECIPROCAL_CONDITION * self._scale, rounding)
        with suppress(np.linalg.LinAlgError):
            factor = cholesky(system)
            if lapack.dpocon(factor, self._scale, uplo="U")[0] * self._scale >= least:
                return factor, 0.0
        system[np.diag_indices_from(system)] += 2.0 * least
        return cholesky(system), 2.0 * least


def _radial(queries: FloatArray, centres: FloatArray) -> FloatArray:
    """Return phi from each of points (q, d) to each centre (n, d), (q, n)."""
    squared = cdist(queries, centres, "sqeuclidean")
    return np.asarray(0.5 * squared * np.log(np.where(squared > 0.0, squared, 1.0)))


def _polynomials(points: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(points)), points])
