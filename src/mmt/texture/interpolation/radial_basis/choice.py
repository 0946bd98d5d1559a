"""Kernel, degree, shape parameter and smoothing of a network, chosen by leave-one-out error.

The error of every centre without itself follows from one solution in closed form,
``e_i = w_i / (A^-1)_ii`` (Rippa, Adv. Comput. Math. 11 (1999), 193-210; the block inverse shows
it for the system with polynomials and smoothing as well). One eigendecomposition of the
system's positive definite block, O(n^3), serves every smoothing at O(n^2 m): nothing is solved
again, neither for a centre left out nor for a smoothing.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings
from mmt.texture.interpolation.radial_basis.samples import SampleTable
from mmt.texture.interpolation.radial_basis.solving import (
    INDISPENSABLE,
    LEAST_RECIPROCAL_CONDITION,
    Complement,
    polynomial_basis,
    smoothed_matrix,
)

CANDIDATES: Final[tuple[RadialBasisSettings, ...]] = (
    RadialBasisSettings("linear", 0),
    RadialBasisSettings("linear", 1),
    RadialBasisSettings("thin_plate_spline", 1),
    RadialBasisSettings("thin_plate_spline", 2),
    RadialBasisSettings("cubic", 1),
    RadialBasisSettings("cubic", 2),
    RadialBasisSettings("quintic", 2),
    *(RadialBasisSettings("multiquadric", 0, epsilon) for epsilon in (1.0, 3.0, 9.0)),
    *(RadialBasisSettings("inverse_multiquadric", 0, epsilon) for epsilon in (1.0, 2.0, 4.0)),
    *(RadialBasisSettings("gaussian", 0, epsilon) for epsilon in (1.0, 2.0, 4.0)),
)
"""What is tried where nothing else is said, each with every smoothing."""

RELATIVE_SMOOTHINGS: Final[tuple[float, ...]] = (0.0, *(10.0 ** (0.5 * k) for k in range(-16, 3)))
"""Over the mean eigenvalue of the system without smoothing."""

LARGEST_CHOICE: Final = 400
"""Most centres that decide; of more, this many are taken, evenly spread over their order."""

FEWEST_ERRORS: Final = 4
"""Centres that can be left out; fewer say nothing, and the default settings stay."""


@dataclass(frozen=True)
class Trial:
    """Settings, and their leave-one-out error: the root mean square over centres and outputs.

    Each output's error is divided by its scale. NaN where too few centres can be left out.
    """

    settings: RadialBasisSettings
    error: float


def choose_settings(
    points: FloatArray,
    values: FloatArray,
    scale: FloatArray | None = None,
    candidates: Sequence[RadialBasisSettings] = CANDIDATES,
) -> Trial:
    """Return the settings with the least leave-one-out error.

    Parameters
    ----------
    points, values
        As `RadialBasisSystem` takes them, shapes (n, d) and (n, m).
    scale
        Scale of each output, shape (m,), positive: errors are divided by it. By default the
        standard deviation over the samples.
    candidates
        Their smoothing is not used.

    Returns
    -------
    trial
        With too few samples to tell, the default settings and NaN.

    Notes
    -----
    O(n^3) for each candidate, and once; the sum over 16 candidates takes about as long as
    100 solutions.
    """
    trials = [t for t in tried(points, values, scale, candidates) if np.isfinite(t.error)]
    if not trials:
        return Trial(RadialBasisSettings(), np.nan)
    return min(trials, key=lambda trial: trial.error)


def tried(
    points: FloatArray,
    values: FloatArray,
    scale: FloatArray | None = None,
    candidates: Sequence[RadialBasisSettings] = CANDIDATES,
) -> Iterator[Trial]:
    """Give every candidate with each smoothing that leaves its system well conditioned."""
    table = SampleTable(points, values)
    kept = np.arange(len(table))
    if len(table) > LARGEST_CHOICE:
        kept = np.linspace(0, len(table) - 1, LARGEST_CHOICE).astype(np.int64)
    centres, wanted, counts = table.points[kept], table.values[kept], table.counts[kept]
    if scale is None:
        scale = wanted.std(axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    for candidate in candidates:
        plain = replace(candidate, smoothing=0.0)
        family = _Family(centres, wanted / scale, counts, plain)
        for relative in RELATIVE_SMOOTHINGS if family.left else ():
            smoothing = relative * family.mean_eigenvalue
            if family.is_sound(smoothing):
                errors = family.leave_one_out(smoothing)
                yield Trial(replace(plain, smoothing=smoothing), _mean(errors))


def _mean(errors: FloatArray) -> float:
    told = errors[np.isfinite(errors).all(axis=1)]
    return float(np.sqrt(np.mean(told**2))) if len(told) >= FEWEST_ERRORS else np.nan


class _Family:
    """All smoothings of one system.

    Centres of several samples are scaled by the root of their number, which makes the
    smoothing the same for all: S K S + smoothing, against S G, for S w.
    """

    def __init__(
        self,
        points: FloatArray,
        values: FloatArray,
        counts: FloatArray,
        settings: RadialBasisSettings,
    ) -> None:
        self._roots = np.sqrt(counts)[:, None]
        matrix = smoothed_matrix(points, counts, settings) * self._roots * self._roots.T
        _, polynomials = polynomial_basis(points, settings)
        columns, _ = np.linalg.qr(polynomials * self._roots)
        complement = Complement(columns)
        self.left = len(points) - columns.shape[1]
        if self.left:
            self._eigenvalues, vectors = np.linalg.eigh(complement.reduce(matrix))
            self._vectors = complement.raise_columns(vectors)
            self._squares = self._vectors**2
            self._coordinates = self._vectors.T @ (values * self._roots)

    @property
    def mean_eigenvalue(self) -> float:
        """The mean, which rounding leaves positive where single ones may not be."""
        return float(self._eigenvalues.mean())

    def is_sound(self, smoothing: float) -> bool:
        """Say whether the smoothed system is well conditioned."""
        least, largest = self._eigenvalues[0] + smoothing, self._eigenvalues[-1] + smoothing
        return bool(least > LEAST_RECIPROCAL_CONDITION * largest)

    def leave_one_out(self, smoothing: float) -> FloatArray:
        """Return the error of each centre without it, (n, m); NaN as `RadialBasisSystem`."""
        inverse = 1.0 / (self._eigenvalues + smoothing)
        weights = self._vectors @ (inverse[:, None] * self._coordinates)
        pivots = self._squares @ inverse
        pivots[pivots * (self._eigenvalues[-1] + smoothing) <= INDISPENSABLE] = np.nan
        errors: FloatArray = weights / (pivots[:, None] * self._roots)
        return errors
