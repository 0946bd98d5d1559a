"""Prediction of further blocks of a surface from its cells.

Each component of the spectrum is a Gaussian process over the stroke
(`mmt.texture.field.covariance`; Rasmussen and Williams, Gaussian Processes for Machine Learning,
2006), plus what a place or a stroke has in common, plus the scatter of single blocks
(`mmt.texture.surfaces.cells`). Blocks are predicted in their order, each from the cells and from
the blocks before it: what is left are *innovations*, which neither an unexplored part of the plane
nor patches of the surface make alike.

The hyperparameters are those of `mmt.texture.field.covariance.settings`, weighted by their
evidence, component by component: the shape of the spectrum may vary otherwise than the level. All
are kept: of little that was felt the likeliest few are too sure.

Cost: O(s c^3) for s settings and c cells, at most `SETTINGS` and `cells.LARGEST`, where blocks were
added, and O(s (c^2 + n^3)) a block, the n-th in a row.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.field.covariance import Between, Coordinates, settings
from mmt.texture.field.scatter import PATCH_MM
from mmt.texture.surfaces.bands import COMPONENTS
from mmt.texture.surfaces.blocks import SurfaceBlock, coordinates_of
from mmt.texture.surfaces.cells import SurfaceCells
from mmt.texture.surfaces.prior import CONSTANTS, SIZES

SETTINGS: Final = 8
"""Hyperparameters that are weighed."""

_OTHER_STROKE: Final = 0.2
"""Distance in u and v over which what a stroke has in common changes: a cell's width."""

_LARGE: Final = 1e100  # above any sum of squares


class Innovations(NamedTuple):
    """What is new in n blocks: standardised, (n, `COMPONENTS`), and what they were divided by."""

    standardised: FloatArray
    deviation: FloatArray


class SurfacePosterior:
    """Posterior given the cells of a surface; without any it is the prior, an unknown surface.

    Parameters
    ----------
    cells
        Cells of the surface.
    """

    def __init__(self, cells: SurfaceCells) -> None:
        self._directed = cells.directed
        self._nugget, self._sill = cells.nugget, cells.sill
        self._settings = settings(SETTINGS, directed=cells.directed, rough=False)
        self._weights = np.full((SETTINGS, COMPONENTS), 1.0 / SETTINGS)
        self._at = cells.centres if len(cells) else None
        if self._at is not None:
            self._condition(self._at, cells)

    def _condition(self, at: Coordinates, cells: SurfaceCells) -> None:
        """Condition on the cells, and weigh each setting for each component by its evidence."""
        covariance = self._covariance(Between(at, at, directed=self._directed))
        diagonal = np.arange(len(cells))
        covariance[..., diagonal, diagonal] += cells.errors
        factor = np.linalg.cholesky(covariance)
        self._whitening = np.linalg.inv(factor)
        self._whitened = np.einsum("sjab,bj->sja", self._whitening, cells.values)
        logarithms = np.log(factor[..., diagonal, diagonal]).sum(axis=2)
        evidence = -0.5 * np.square(self._whitened).sum(axis=2) - logarithms
        self._weights = np.exp(evidence - evidence.max(axis=0))
        self._weights /= self._weights.sum(axis=0)

    def _covariance(self, between: Between) -> FloatArray:
        """Return the prior covariances, (s, `COMPONENTS`, k, l)."""
        plain = np.array([between.covariance(one, constant=0.0) for one in self._settings])
        sizes, constants = np.square(SIZES)[:, None, None], np.square(CONSTANTS)[:, None, None]
        return np.asarray(sizes * plain[:, None] + constants)

    def explained(self, blocks: Sequence[SurfaceBlock]) -> FloatArray:
        """Return the whitened covariances of n blocks with c cells, (s, `COMPONENTS`, c, n)."""
        if self._at is None:
            return np.zeros((SETTINGS, COMPONENTS, 0, len(blocks)))
        at = coordinates_of(np.array([block.stroke for block in blocks]))
        return np.asarray(
            self._whitening @ self._covariance(Between(self._at, at, directed=self._directed))
        )

    def innovations(
        self, blocks: Sequence[SurfaceBlock], explained: FloatArray | None = None
    ) -> Innovations:
        """Return what is new in each of n blocks, given the cells and the blocks before it.

        Parameters
        ----------
        blocks
            At least one.
        explained
            `explained` of these blocks, where it is known.
        """
        explained = self.explained(blocks) if explained is None else explained
        at = coordinates_of(np.array([block.stroke for block in blocks]))
        covariance = self._covariance(Between(at, at, directed=self._directed))
        covariance += self._scatter(np.array([block.position_mm for block in blocks]), at)
        rests = np.broadcast_to(
            np.array([block.values for block in blocks]).T, covariance.shape[:3]
        )
        if self._at is not None:
            covariance -= explained.swapaxes(2, 3) @ explained
            rests = rests - np.einsum("sjcn,sjc->sjn", explained, self._whitened)
        factor, whitened = _whitened(covariance, rests)
        return self._mixed(whitened, np.diagonal(factor, axis1=2, axis2=3))

    def _scatter(self, positions_mm: FloatArray, at: Coordinates) -> FloatArray:
        """Return the covariances of n blocks' scatter, (`COMPONENTS`, n, n)."""
        apart_mm = np.hypot(*(positions_mm[:, None] - positions_mm[None]).transpose(2, 0, 1))
        other = np.abs(np.subtract.outer(at.u, at.u)) + np.abs(np.subtract.outer(at.v, at.v))
        alike = 0.5 * (np.exp(-apart_mm / PATCH_MM) + np.exp(-other / _OTHER_STROKE))
        own = self._nugget[:, None, None] * np.eye(len(other))
        return np.asarray(self._sill[:, None, None] * alike + own)

    def _mixed(self, whitened: FloatArray, deviation: FloatArray) -> Innovations:
        """Return the innovations of the mixture over settings, by its mean and its variance."""
        each = whitened * deviation
        weights = self._weights[:, :, None]
        mean = (weights * each).sum(axis=0)
        second = (weights * (np.square(deviation) + np.square(each - mean))).sum(axis=0)
        mixed = np.sqrt(second)
        return Innovations((mean / mixed).T, mixed.T)


def _whitened(covariance: FloatArray, rests: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the Cholesky factor (..., n, n) and its inverse times n values (..., n).

    Both by one factorisation: the last row of the factor of a matrix that is bordered with the
    values is what is sought.
    """
    count = covariance.shape[-1]
    bordered = np.zeros((*covariance.shape[:-2], count + 1, count + 1))
    bordered[..., :count, :count] = covariance
    bordered[..., count, :count] = rests
    bordered[..., count, count] = _LARGE
    factor = np.linalg.cholesky(bordered)
    return factor[..., :count, :count], factor[..., count, :count]
