"""Radial basis functions and the polynomials beside them, compiled.

``f(u) = sum_j w_j phi(|u - q_j|) + sum_k d_k g_k(u)`` (Abdulali and Jeon, "Data-Driven
Rendering of Anisotropic Haptic Textures", 2016, eq. 1). Names, signs and least degrees are
those of `scipy.interpolate.RBFInterpolator`, after Fasshauer, "Meshfree Approximation Methods
with MATLAB" (2007), chapter 8: with a polynomial of at least the stated degree, the matrix
``phi(|q_i - q_j|)`` is positive definite on all weights that are orthogonal to it.

The polynomials are monomials in the normalised coordinates, none of which is far beyond one.
Distances are taken from differences of coordinates: the expanded form
``|u|^2 - 2 u q + |q|^2`` loses the digits that large weights need.
"""

import math
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Final, Literal

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel

KernelName = Literal[
    "linear",
    "thin_plate_spline",
    "cubic",
    "quintic",
    "multiquadric",
    "inverse_multiquadric",
    "inverse_quadratic",
    "gaussian",
]


@dataclass(frozen=True)
class RadialFunction:
    """A function phi: its number in the compiled kernels, and what the network needs with it.

    ``least_degree`` is that of the polynomial, -1 for none. ``scale_free`` functions change
    by a factor alone with the shape parameter, which therefore has no effect on the network.
    """

    number: int
    least_degree: int
    scale_free: bool


FUNCTIONS: Final[dict[KernelName, RadialFunction]] = {
    "linear": RadialFunction(0, 0, scale_free=True),  # -r
    "thin_plate_spline": RadialFunction(1, 1, scale_free=True),  # r^2 log r
    "cubic": RadialFunction(2, 1, scale_free=True),  # r^3
    "quintic": RadialFunction(3, 2, scale_free=True),  # -r^5
    "multiquadric": RadialFunction(4, 0, scale_free=False),  # -sqrt(1 + r^2)
    "inverse_multiquadric": RadialFunction(5, -1, scale_free=False),  # 1 / sqrt(1 + r^2)
    "inverse_quadratic": RadialFunction(6, -1, scale_free=False),  # 1 / (1 + r^2)
    "gaussian": RadialFunction(7, -1, scale_free=False),  # exp(-r^2)
}

_BLOCK: Final = 32
"""Terms added up before they join the sum: the rounding grows as n/32 + 32 instead of n."""


def monomials(dimensions: int, degree: int) -> IntArray:
    """Return the exponents (k, dimensions) of all monomials up to a degree, by degree.

    There are ``k = C(dimensions + degree, degree)``, none for degree -1.
    """
    rows = [
        [choice.count(axis) for axis in range(dimensions)]
        for total in range(degree + 1)
        for choice in combinations_with_replacement(range(dimensions), total)
    ]
    return np.array(rows, dtype=np.int64).reshape(-1, dimensions)


@kernel("f8(i8, f8)")
def radial_value(number: int, squared: float) -> float:  # noqa: PLR0911 - one a function
    """Return phi of a squared distance, times the squared shape parameter already."""
    if number == 0:
        return -math.sqrt(squared)
    if number == 1:
        return 0.5 * squared * math.log(squared) if squared > 0.0 else 0.0
    if number == 2:
        return squared * math.sqrt(squared)
    if number == 3:
        return -squared * squared * math.sqrt(squared)
    if number == 4:
        return -math.sqrt(1.0 + squared)
    if number == 5:
        return 1.0 / math.sqrt(1.0 + squared)
    if number == 6:
        return 1.0 / (1.0 + squared)
    return math.exp(-squared)


@kernel("void(i8, f8, f8[:, ::1], f8[::1], f8[::1])")
def radial_row_into(
    number: int, epsilon: float, centres: FloatArray, query: FloatArray, row: FloatArray
) -> None:
    """Write phi from a point (d,) to the first centres (n, d), as many as `row` (n,) takes."""
    scale = epsilon * epsilon
    for j in range(len(row)):
        squared = 0.0
        for axis in range(len(query)):
            step = query[axis] - centres[j, axis]
            squared += step * step
        row[j] = radial_value(number, scale * squared)


@kernel("void(i8, f8, f8[:, ::1], f8[:, ::1])")
def radial_matrix_into(
    number: int, epsilon: float, centres: FloatArray, matrix: FloatArray
) -> None:
    """Write phi between all centres (n, d) into `matrix` (n, n), exactly symmetric."""
    for i in range(len(centres)):
        radial_row_into(number, epsilon, centres, centres[i], matrix[i, : i + 1])
        for j in range(i):
            matrix[j, i] = matrix[i, j]


@kernel("f8(i8[::1], f8[::1])")
def monomial(exponents: IntArray, point: FloatArray) -> float:
    """Return the monomial with the exponents (at least d,) at a point (d,)."""
    product = 1.0
    for axis in range(len(point)):
        for _ in range(exponents[axis]):
            product *= point[axis]
    return product


@kernel("void(i8[:, ::1], f8[::1], f8[::1])")
def polynomial_row_into(exponents: IntArray, query: FloatArray, row: FloatArray) -> None:
    """Write the monomials (k,) with these exponents (k, d) at a point (d,)."""
    for k in range(len(exponents)):
        row[k] = monomial(exponents[k], query)


@kernel("void(i8[:, ::1], f8[:, ::1], f8[:, ::1])")
def polynomial_matrix_into(exponents: IntArray, points: FloatArray, matrix: FloatArray) -> None:
    """Write the monomials at all points (n, d) into `matrix` (n, k)."""
    for i in range(len(points)):
        polynomial_row_into(exponents, points[i], matrix[i])


@kernel("void(i8, f8, f8[:, ::1], f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[::1])")
def evaluate_into(
    number: int,
    epsilon: float,
    centres: FloatArray,
    weights: FloatArray,
    exponents: IntArray,
    coefficients: FloatArray,
    query: FloatArray,
    work: FloatArray,
    values: FloatArray,
) -> None:
    """Write a network's outputs at one point, without allocation.

    Parameters
    ----------
    number, epsilon
        Number of the radial function, and its shape parameter.
    centres, weights
        Shapes (n, d) and (n, m).
    exponents, coefficients
        Exponents and coefficients of the polynomial, shapes (k, d) and (k, m).
    query : (d,)
        A point of the unit box.
    work : (m,)
        Scratch.
    values : (m,)
        Written.

    Notes
    -----
    Costs n radial functions and (n + k) m multiplications. Weights cancel each other, by many
    digits where centres are close; sums over blocks keep what rounding takes below n/32 + 32
    units of the largest term.
    """
    outputs = len(values)
    scale = epsilon * epsilon
    values[:] = 0.0
    first = 0
    while first < len(centres):
        work[:] = 0.0
        last = min(first + _BLOCK, len(centres))
        for j in range(first, last):
            squared = 0.0
            for axis in range(len(query)):
                step = query[axis] - centres[j, axis]
                squared += step * step
            phi = radial_value(number, scale * squared)
            for i in range(outputs):
                work[i] += phi * weights[j, i]
        for i in range(outputs):
            values[i] += work[i]
        first = last
    for k in range(len(exponents)):
        product = monomial(exponents[k], query)
        for i in range(outputs):
            values[i] += product * coefficients[k, i]


@kernel("void(i8, f8, f8[:, ::1], f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def evaluate_each_into(
    number: int,
    epsilon: float,
    centres: FloatArray,
    weights: FloatArray,
    exponents: IntArray,
    coefficients: FloatArray,
    queries: FloatArray,
    values: FloatArray,
) -> None:
    """Do `evaluate_into` for every point (q, d); write (q, m)."""
    work = np.empty(values.shape[1])
    for index in range(len(queries)):
        evaluate_into(
            number,
            epsilon,
            centres,
            weights,
            exponents,
            coefficients,
            queries[index],
            work,
            values[index],
        )
