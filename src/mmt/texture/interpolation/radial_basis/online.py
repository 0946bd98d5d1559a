"""A radial basis function network whose samples come and go, at O(n^2) each.

The system of n samples is kept with its inverse. A further sample borders it, and the inverse
with it (the block inverse; Schur complement c - a^T A^-1 a); a sample that leaves takes its row
and column out, ``A^-1 - m m^T / m_i`` with m the column of the inverse. The diagonal of the
inverse gives all leave-one-out errors at once (see `RadialBasisSystem.leave_one_out`).

Rounding is watched, not guessed. After every change two products with the system and one with
its inverse, O(n^2), give

- the misfit at the samples of a combination of the outputs: where it is more than a network
  needs or rounding explains, all outputs are refined;
- how far inverse times system is from one in a generic direction: where that is more than
  refinement can make good, the system is solved anew, at O(n^3).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.interpolation.radial_basis.functions import (
    polynomial_row_into,
    radial_row_into,
    radial_value,
)
from mmt.texture.interpolation.radial_basis.network import RadialBasisNetwork, RadialBasisSettings
from mmt.texture.interpolation.radial_basis.samples import SampleTable
from mmt.texture.interpolation.radial_basis.solving import (
    INDISPENSABLE,
    REFINABLE,
    PolynomialBasis,
    add_outer,
    border_inverse,
    border_matrix,
    move_last,
    solve,
    usable_degree,
)

LARGEST_MISFIT: Final = 1e-9
"""At the samples, over the largest value; what rounding alone explains is allowed beside it."""

_EPS: Final = float(np.finfo(np.float64).eps)


class RadialBasisSystem:
    """Samples, and the network that goes through or near them.

    Parameters
    ----------
    points, values
        At least one sample: shapes (n, d), in the unit box, and (n, m), finite and at most
        1e100 in magnitude. Samples closer than 1e-6 become one centre with their mean.
    settings
        See `RadialBasisSettings`. With too few samples for the degree it is lower until there
        are enough.

    Raises
    ------
    InputError
        There is no sample, shapes disagree, or a number is out of its range.
    """

    def __init__(
        self, points: FloatArray, values: FloatArray, settings: RadialBasisSettings | None = None
    ) -> None:
        self.settings = settings or RadialBasisSettings()
        self._table = SampleTable(points, values)
        self.solutions = 0
        self._solve()

    @property
    def centres(self) -> FloatArray:
        """Where the centres are, shape (c, d)."""
        return self._table.points

    @property
    def handles(self) -> list[list[int]]:
        """The samples of each centre; the first ones are numbered 0 ... n-1."""
        return self._table.handles

    @property
    def degree(self) -> int:
        """The degree of the polynomial in use."""
        return self._basis.degree

    def add(self, point: FloatArray, values: FloatArray) -> int:
        """Add a sample, point (d,) and values (m,); return its handle. O(n^2)."""
        handle, centre = self._table.add(point, values)
        if centre < len(self._table) - 1 or len(self._table.handles[centre]) > 1:
            self._share(centre)
        elif not self._border(centre):
            self._solve()
        return handle

    def remove(self, handle: int) -> None:
        """Remove a sample. O(n^2).

        Raises
        ------
        InputError
            There is no such sample, or it is the only one.
        """
        centre = self._table.centre_of(handle)
        last = len(self._table) - 1
        is_whole = len(self._table.handles[centre]) == 1
        self._table.remove(handle)
        if not is_whole:
            self._share(centre)
        elif not self._take_out(centre, last):
            self._solve()

    def replace(self, values: Mapping[int, FloatArray]) -> None:
        """Give samples, by their handles, other values (m,). O(n^2 m) for any number of them.

        Raises
        ------
        InputError
            There is no such sample, or the values are out of their range.
        """
        self._table.replace(values)
        self._solution[: self._size] = self._inverse[: self._size, : self._size] @ self._wanted()
        self._refine()

    def leave_one_out(self) -> FloatArray:
        """Return how far the network without a centre is from that centre's values, (c, m).

        ``e_i = w_i / (A^-1)_ii`` exactly, polynomials and smoothing included (Rippa, "An
        algorithm for selecting a good value for the parameter c in radial basis function
        interpolation", Adv. Comput. Math. 11 (1999), 193-210), without solving again: O(n m).
        NaN for a centre without which some polynomial could not be told.
        """
        rank = self._basis.rank
        pivots = np.diag(self._inverse)[rank : self._size].copy()
        pivots[pivots * self._scale <= INDISPENSABLE] = np.nan
        errors: FloatArray = self._solution[rank : self._size] / pivots[:, None]
        return errors

    def network(self) -> RadialBasisNetwork:
        """Return the network of the samples as they are.

        The smoothing of its settings is what was needed, not only what was asked for.
        """
        rank, size = self._basis.rank, self._size
        return RadialBasisNetwork(
            settings=replace(self.settings, smoothing=self.settings.smoothing + self._added),
            centres=self._table.points.copy(),
            weights=self._solution[rank:size].copy(),
            exponents=self._basis.exponents,
            coefficients=np.ascontiguousarray(self._basis.transform @ self._solution[:rank]),
        )

    def _solve(self) -> None:
        """Solve anew. O(n^3)."""
        solved = solve(self._table.points, self._table.counts, self.settings)
        self.solutions += 1
        self._basis: PolynomialBasis = solved.basis
        self._added, self._scale, self._least = solved.added_smoothing, solved.scale, solved.least
        self._size = len(solved.matrix)
        self._matrix, self._inverse = solved.matrix, solved.inverse
        self._norm = float(np.abs(solved.matrix).sum(axis=0).max())
        self._solution = solved.inverse @ self._wanted()
        self._refine()
        self._refine()

    def _wanted(self) -> FloatArray:
        """Return the right-hand side (r + c, m)."""
        return np.vstack(
            [np.zeros((self._basis.rank, self._table.values.shape[1])), self._table.values]
        )

    def _refine(self) -> None:
        size = self._size
        misfit = self._matrix[:size, :size] @ self._solution[:size] - self._wanted()
        self._solution[:size] -= self._inverse[:size, :size] @ misfit

    def _border(self, centre: int) -> bool:
        """Add the row and column of the last centre; say whether that was possible."""
        size, point = self._size, self._table.points[centre]
        if self._has_another_basis(point):
            return False
        self._make_room()
        column = self._column(point, centre)
        matrix, inverse = self._matrix[:size, :size], self._inverse[:size, :size]
        solved = inverse @ column
        correction = inverse @ (matrix @ solved - column)
        solved -= correction
        corner = radial_value(self.settings.function.number, 0.0) + self._smoothing(centre)
        schur = corner - float(column @ solved)
        self._norm = max(self._norm, float(np.abs(column).sum()))
        if _largest(correction) > REFINABLE * _largest(solved):
            return False
        if not schur > self._least:
            return False
        weight = (self._table.values[centre] - column @ self._solution[:size]) / schur
        self._solution[:size] -= np.outer(solved, weight)
        self._solution[size] = weight
        border_inverse(self._inverse, size, solved, schur)
        border_matrix(self._matrix, size, column, corner)
        self._size += 1
        return self._is_sound()

    def _take_out(self, centre: int, last: int) -> bool:
        """Take a row and column out, the last centre taking its place; say whether possible."""
        place, size = self._basis.rank + centre, self._size
        pivot = float(self._inverse[place, place])
        wanted = usable_degree(last, self._table.points.shape[1], self.settings)
        if pivot * self._scale <= INDISPENSABLE or wanted != self._basis.degree:
            return False
        column = self._inverse[:size, place].copy()
        self._solution[:size] -= np.outer(column, self._solution[place] / pivot)
        add_outer(self._inverse, size, column, -1.0 / pivot)
        for square in (self._inverse, self._matrix):
            move_last(square, size, place, size - 1)
        self._solution[place] = self._solution[size - 1]
        self._size -= 1
        return self._is_sound()

    def _make_room(self) -> None:
        """Have arrays that can take a further row; they grow by half, O(n) an addition."""
        if self._size == len(self._matrix):
            more = self._size // 2 + 16
            self._matrix = np.pad(self._matrix, ((0, more), (0, more)))
            self._inverse = np.pad(self._inverse, ((0, more), (0, more)))
            self._solution = np.pad(self._solution, ((0, more), (0, 0)))

    def _share(self, centre: int) -> None:
        """Follow a centre that has gained or lost one of several samples."""
        place, size = self._basis.rank + centre, self._size
        change = self._smoothing(centre) - (
            float(self._matrix[place, place]) - radial_value(self.settings.function.number, 0.0)
        )
        column = self._inverse[:size, place].copy()
        factor = change / (1.0 + change * float(column[place]))
        self._solution[:size] -= np.outer(column, factor * self._solution[place])
        add_outer(self._inverse, size, column, -factor)
        self._matrix[place, place] += change
        misfit = self._table.values[centre] - self._matrix[place, :size] @ self._solution[:size]
        self._solution[:size] += np.outer(self._inverse[:size, place], misfit)
        if not self._is_sound():
            self._solve()

    def _smoothing(self, centre: int) -> float:
        return self.settings.smoothing / float(self._table.counts[centre]) + self._added

    def _has_another_basis(self, point: FloatArray) -> bool:
        """Say whether a further centre lets the polynomial have more terms."""
        count, dimensions = len(self._table), self._table.points.shape[1]
        if usable_degree(count, dimensions, self.settings) != self._basis.degree:
            return True
        row = np.empty(len(self._basis.exponents))
        polynomial_row_into(self._basis.exponents, point, row)
        return self._basis.misses(row)

    def _column(self, point: FloatArray, count: int) -> FloatArray:
        """Return the polynomials at a point and its radial functions to the first centres."""
        monomials = np.empty(len(self._basis.exponents))
        polynomial_row_into(self._basis.exponents, point, monomials)
        radial = np.empty(count)
        number, epsilon = self.settings.function.number, self.settings.epsilon
        radial_row_into(number, epsilon, self._table.points, point, radial)
        return np.concatenate([monomials @ self._basis.transform, radial])

    def _is_sound(self) -> bool:
        """Check system, inverse and solution against each other; refine where that helps."""
        size = self._size
        matrix, inverse = self._matrix[:size, :size], self._inverse[:size, :size]
        values = self._table.values
        mix = 1.0 / np.maximum(np.abs(values).max(axis=0), np.finfo(np.float64).tiny)
        probes = np.column_stack(
            [self._solution[:size] @ mix, np.where(np.arange(size) % 2, 1, -1)]
        )
        reached = matrix @ probes
        returned = inverse @ reached[:, 1]
        if not _largest(returned - probes[:, 1]) <= REFINABLE:
            return False
        misfit = reached[:, 0]
        misfit[self._basis.rank :] -= values @ mix
        explained = 4.0 * _EPS * self._norm * _largest(probes[:, 0])
        if _largest(misfit) > max(LARGEST_MISFIT * values.shape[1], explained):
            self._refine()
        return True


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))
