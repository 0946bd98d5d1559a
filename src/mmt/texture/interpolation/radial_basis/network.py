"""Radial basis function networks: what they are told, and the network itself.

A network is immutable, as a texture model is: `mmt.texture.interpolation.radial_basis.online`
solves for it and gives a new one where samples come and go,
`mmt.texture.interpolation.radial_basis.choice` chooses its settings.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError
from mmt.texture.interpolation.radial_basis.functions import (
    FUNCTIONS,
    KernelName,
    RadialFunction,
    evaluate_each_into,
)

LARGEST_DEGREE: Final = 4
"""A polynomial of higher degree leaves the data between and beyond the samples."""


@dataclass(frozen=True)
class RadialBasisSettings:
    """What a network is built with.

    Attributes
    ----------
    kernel
        The radial function, by its name in `scipy.interpolate.RBFInterpolator`.
    degree
        Degree of the polynomial, -1 for none; at least the least one of the kernel. None takes
        that one, but 0 where it would be none.
    epsilon
        Shape parameter: phi is taken of epsilon times the distance. Without effect for
        linear, thin_plate_spline, cubic and quintic.
    smoothing
        Added to the diagonal; 0 goes through every sample. A centre of several coincident
        samples gets its share, as if they were fitted singly.

    Raises
    ------
    InputError
        A value is unknown or out of its range.
    """

    kernel: KernelName = "thin_plate_spline"
    degree: int | None = None
    epsilon: float = 1.0
    smoothing: float = 0.0

    def __post_init__(self) -> None:
        if self.kernel not in FUNCTIONS:
            raise InputError(f"kernel is {self.kernel!r}, allowed are {', '.join(FUNCTIONS)}")
        least = self.function.least_degree
        if self.degree is not None and not least <= self.degree <= LARGEST_DEGREE:
            raise InputError(
                f"degree is {self.degree}: with {self.kernel}, {least} to {LARGEST_DEGREE}"
            )
        if not 1e-3 <= self.epsilon <= 1e3:
            raise InputError(f"epsilon is {self.epsilon}: 0.001 to 1000 in the unit box")
        if not 0.0 <= self.smoothing <= 1e6:
            raise InputError(f"smoothing is {self.smoothing}: 0 to a million")

    @property
    def function(self) -> RadialFunction:
        """The radial function."""
        return FUNCTIONS[self.kernel]

    @property
    def highest_degree(self) -> int:
        """The degree of the polynomial where there are samples enough for it."""
        return max(self.function.least_degree, 0) if self.degree is None else self.degree


PUBLISHED: Final = RadialBasisSettings("thin_plate_spline", 1)
"""For the networks of the papers, which give the form, a radial function at every sample and a
polynomial, and name neither: the smoothest in a plane, with no shape parameter to choose."""


@dataclass(frozen=True)
class RadialBasisNetwork:
    """A function from the unit box to m outputs.

    Attributes
    ----------
    settings
        What it was built with.
    centres, weights
        Shapes (n, d) and (n, m).
    exponents, coefficients
        Exponents and coefficients of the polynomial, shapes (k, d) and (k, m).
    """

    settings: RadialBasisSettings
    centres: FloatArray
    weights: FloatArray
    exponents: IntArray
    coefficients: FloatArray

    @cached_property
    def number(self) -> int:
        """The radial function's number in the compiled kernels."""
        return self.settings.function.number

    def at(self, queries: FloatArray) -> FloatArray:
        """Return the outputs (q, m) at points (q, d); clipped to the unit box.

        Costs n radial functions and n m multiplications a point.
        """
        located = np.ascontiguousarray(np.clip(queries, 0.0, 1.0), dtype=np.float64)
        values = np.empty((len(located), self.weights.shape[1]))
        evaluate_each_into(
            self.number,
            self.settings.epsilon,
            self.centres,
            self.weights,
            self.exponents,
            self.coefficients,
            located,
            values,
        )
        return values
