"""What is known of one surface, and how likely it makes what the tool hears now.

Blocks that stand close to each other in the plane are merged into *cells*, so that the cost does
not grow with time: n cells, `LARGEST` at most. The posterior of the Gaussian process of
`mmt.texture.surfaces.prior` given the cells predicts any further blocks jointly: their
level and shape may be off together by what is not known of the surface, and each of them by the
noise of a block. That joint density is what is returned. It is exact for the model assumed, so
that between two surfaces its ratio is a Bayes factor.

Cost: a factorisation, 2 n^3 / 3, when blocks were added; n^2 for each block that is predicted.
With n = 150: 2 ms, and 0.1 ms a block. Stability: covariances are positive definite by the
noise on their diagonal, `NOISE` over the number of blocks in a cell, against a largest prior
variance of about 50: a condition number below 1e7.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from mmt.arrays import FloatArray
from mmt.texture.surfaces.blocks import BANDS, SurfaceBlock
from mmt.texture.surfaces.prior import (
    LENGTHS,
    LEVEL,
    NOISE,
    NOISES,
    RESIDUALS,
    SHAPE,
    USUAL,
    Roughness,
    covariance,
    mean_of,
    turning,
)

LARGEST: Final = 250
"""Most cells of a surface; the one that was not touched for longest leaves for the next."""

_CELL_WIDTH: Final = 0.2  # of the logarithms of speed and force
_SECTORS: Final = 12
_LARGEST_WEIGHT: Final = 30.0
_LEAST_EVIDENCE: Final = 8
_LOG_TWO_PI: Final = float(np.log(2.0 * np.pi))

_KINDS: Final = {"level": LEVEL, "shape": SHAPE}
_SCALES: Final = {"level": float(BANDS), "shape": 1.0}
"""Variance of a component over that of a band: the level is what all bands have in common."""


@dataclass
class _Cell:
    inputs: FloatArray
    values: FloatArray
    weight: float = 1.0

    def merge(self, inputs: FloatArray, values: FloatArray) -> None:
        """Take a further block into the means; beyond a weight old ones fade."""
        share = 1.0 / (self.weight + 1.0)
        self.inputs = self.inputs + share * (inputs - self.inputs)
        self.values = self.values + share * (values - self.values)
        self.weight = min(self.weight + 1.0, _LARGEST_WEIGHT)


@dataclass(frozen=True, eq=False)
class _Posterior:
    """One kind of component given the cells: Cholesky factor (n, n), whitened rests (n, c)."""

    factor: FloatArray
    whitened: FloatArray


class SurfaceKnowledge:
    """The blocks of one surface; without any it is the prior, a surface that nobody knows."""

    def __init__(self) -> None:
        self._cells: dict[tuple[int, ...], _Cell] = {}
        self._rough: dict[str, Roughness] = dict(USUAL)
        self._judged_cells = 0
        self._posteriors: dict[str, _Posterior] | None = None
        self.blocks = 0
        """How many blocks were added."""

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self._cells)

    def add(self, blocks: Sequence[SurfaceBlock]) -> None:
        """Learn that these blocks are of this surface."""
        for block in blocks:
            values = turning() @ block.log_power
            key = _key(block.inputs)
            cell = self._cells.pop(key, None)
            if cell is None:
                cell = _Cell(block.inputs, values)
                if len(self._cells) >= LARGEST:
                    del self._cells[next(iter(self._cells))]
            else:
                cell.merge(block.inputs, values)
            self._cells[key] = cell  # behind those that were touched before
            self.blocks += 1
        if blocks:
            self._posteriors = None

    def log_likelihood(self, inputs: FloatArray, log_power: FloatArray) -> FloatArray:
        """Return how likely the first block is, the first two, and so on, jointly.

        Parameters
        ----------
        inputs : (n, 2) or (n, 4)
            Of n blocks.
        log_power : (n, `BANDS`)
            Of the same.

        Returns
        -------
        log_likelihood
            Natural logarithms of densities, shape (n,).
        """
        if not len(inputs):
            return np.empty(0)
        values = log_power @ turning().T
        return self._predicted("level", inputs, values[:, :1]) + self._predicted(
            "shape", inputs, values[:, 1:]
        )

    def spread(self, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how well level and shape are known at inputs (n, d): standard deviations (n,).

        In natural logarithms of the power in a band, without the noise of a block.
        """
        found = []
        for kind in _KINDS:
            _, spread = self._explain(kind, inputs)
            found.append(np.sqrt(np.maximum(np.diag(spread), 0.0) / _SCALES[kind]))
        return found[0], found[1]

    def _predicted(self, kind: str, inputs: FloatArray, values: FloatArray) -> FloatArray:
        explained, spread = self._explain(kind, inputs)
        spread[np.diag_indices_from(spread)] += self._rough[kind].noise * NOISE
        factor = cholesky(spread, lower=True, check_finite=False)
        rest = values - _mean(kind, inputs) - explained
        whitened = solve_triangular(factor, rest, lower=True, check_finite=False)
        each = (whitened**2).sum(axis=1) + values.shape[1] * (
            2.0 * np.log(np.diag(factor)) + _LOG_TWO_PI
        )
        total: FloatArray = -0.5 * np.cumsum(each)
        return total

    def _explain(self, kind: str, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what the cells explain at inputs, (n, c), and the covariance left, (n, n)."""
        if not self._cells:
            return np.zeros((len(inputs), 1)), _spread(kind, self._rough[kind], inputs, inputs)
        if self._posteriors is None:
            self._posteriors = self._condition()
        posterior, rough = self._posteriors[kind], self._rough[kind]
        across = _spread(kind, rough, self._places(), inputs)
        seen = solve_triangular(posterior.factor, across, lower=True, check_finite=False)
        spread = _spread(kind, rough, inputs, inputs)
        return seen.T @ posterior.whitened, spread - seen.T @ seen

    def _condition(self) -> dict[str, _Posterior]:
        """Factorise the cells' covariances, choosing the roughness where there is evidence."""
        if len(self._cells) >= max(_LEAST_EVIDENCE, 1.5 * self._judged_cells):
            self._judged_cells = len(self._cells)
            for kind in _KINDS:
                self._rough[kind] = self._choose(kind)
        return {kind: self._given(kind, self._rough[kind]) for kind in _KINDS}

    def _given(self, kind: str, rough: Roughness) -> _Posterior:
        places = self._places()
        weights = np.array([cell.weight for cell in self._cells.values()])
        values = np.array([cell.values for cell in self._cells.values()])
        values = values[:, :1] if kind == "level" else values[:, 1:]
        matrix = _spread(kind, rough, places, places)
        matrix[np.diag_indices_from(matrix)] += rough.noise * NOISE / weights
        factor = cholesky(matrix, lower=True, check_finite=False)
        rest = values - _mean(kind, places)
        whitened = solve_triangular(factor, rest, lower=True, check_finite=False)
        return _Posterior(factor, whitened)

    def _choose(self, kind: str) -> Roughness:
        """Return the roughness of most evidence (Rasmussen and Williams, section 5.4.1)."""
        candidates = (
            Roughness(residual, length, noise)
            for residual in RESIDUALS[kind]
            for length in LENGTHS
            for noise in NOISES
        )
        return max(candidates, key=lambda rough: _evidence(self._given(kind, rough)))

    def _places(self) -> FloatArray:
        return np.array([cell.inputs for cell in self._cells.values()])


def _evidence(posterior: _Posterior) -> float:
    squares = float((posterior.whitened**2).sum())
    logarithms = float(np.log(np.diag(posterior.factor)).sum())
    return -0.5 * squares - posterior.whitened.shape[1] * logarithms


def _mean(kind: str, inputs: FloatArray) -> FloatArray:
    """Return the prior mean of a component at inputs (n, d), shape (n, 1)."""
    return np.sqrt(_SCALES[kind]) * mean_of(_KINDS[kind], inputs)[:, None]


def _spread(kind: str, rough: Roughness, one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the prior covariance of a component, shape (n, m)."""
    return _SCALES[kind] * covariance(_KINDS[kind], rough, one, other)


def _key(inputs: FloatArray) -> tuple[int, ...]:
    """Return the cell in which inputs lie."""
    key = [int(np.floor(value / _CELL_WIDTH)) for value in inputs[:2].tolist()]
    if len(inputs) == 4:
        turn = float(np.arctan2(inputs[3], inputs[2])) / (2.0 * np.pi)
        key.append(int(np.floor(turn * _SECTORS)))
    return tuple(key)
