"""Prediction of further blocks of a surface from its cells.

Each component of the spectrum is a Gaussian process over the stroke
(`mmt.texture.field.covariance`; Rasmussen and Williams, Gaussian Processes for Machine Learning,
2006), plus what a place or a stroke has in common, plus the scatter of single blocks
(`mmt.texture.surfaces.cells`). Blocks are predicted in their order, each from the cells and from
the blocks before it: what is left are *innovations*, which neither an unexplored part of the plane
nor patches of the surface make alike.

The hyperparameters are those of `mmt.texture.field.covariance.settings`, weighted by their
evidence, component by component: the shape of the spectrum may vary otherwise than the level. The
likeliest few are kept, and all are weighed again as blocks come.

Cost: O(s c^3) for s settings and c cells, at most `SETTINGS` and `cells.LARGEST`, where blocks were
added, and O(s (c^2 + n^3)) a block, the n-th in a row.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.texture.field.covariance import Between, Coordinates, settings
from mmt.texture.field.scatter import PATCH_MM
from mmt.texture.surfaces.bands import COMPONENTS
from mmt.texture.surfaces.blocks import SurfaceBlock, coordinates_of
from mmt.texture.surfaces.cells import SurfaceCells
from mmt.texture.surfaces.prior import CONSTANTS, SIZES

SETTINGS: Final = 8
"""Hyperparameters that are weighed."""

_KEPT: Final = 4
_OTHER_STROKE: Final = 0.2
"""Distance in u and v over which what a stroke has in common changes: a cell's width."""

_REWEIGHED: Final = 1.2  # times as many blocks as when they were weighed last


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
    before
        The posterior before the newest blocks were added.
    """

    def __init__(self, cells: SurfaceCells, before: "SurfacePosterior | None" = None) -> None:
        self._directed = cells.directed
        self._nugget, self._sill = cells.nugget, cells.sill
        self._every = settings(SETTINGS, directed=cells.directed)
        self._kept: IntArray = np.repeat(np.arange(SETTINGS)[:, None], COMPONENTS, axis=1)
        self._weights = np.full((SETTINGS, COMPONENTS), 1.0 / SETTINGS)
        self._weighed = 0
        self._at: Coordinates | None = None
        if not len(cells):
            return
        weigh = before is None or cells.blocks >= _REWEIGHED * before._weighed
        if not weigh and before is not None:
            self._kept, self._weights = before._kept, before._weights
            self._weighed = before._weighed
        self._at = cells.centres
        evidence = self._condition(cells)
        if weigh:
            self._weighed = cells.blocks
            self._keep_likeliest(evidence)

    def _condition(self, cells: SurfaceCells) -> FloatArray:
        """Condition on the cells; return the log evidence of each setting for each component."""
        assert self._at is not None  # noqa: S101 - for the type
        covariance = self._covariance(Between(self._at, self._at, directed=self._directed))
        diagonal = np.arange(len(cells))
        covariance[..., diagonal, diagonal] += cells.errors
        factor = np.linalg.cholesky(covariance)
        self._whitening = np.linalg.inv(factor)
        self._whitened = np.einsum("sjab,bj->sja", self._whitening, cells.values)
        logarithms = np.log(factor[..., diagonal, diagonal]).sum(axis=2)
        return np.asarray(-0.5 * np.square(self._whitened).sum(axis=2) - logarithms)

    def _keep_likeliest(self, evidence: FloatArray) -> None:
        weights = np.exp(evidence - evidence.max(axis=0))
        kept = np.argsort(-weights, axis=0)[:_KEPT]
        self._weights = np.take_along_axis(weights, kept, axis=0)
        self._weights /= self._weights.sum(axis=0)
        self._kept = kept
        component = np.arange(COMPONENTS)
        self._whitening = self._whitening[kept, component]
        self._whitened = self._whitened[kept, component]

    def _covariance(self, between: Between) -> FloatArray:
        """Return the prior covariances, (s, `COMPONENTS`, k, l)."""
        own, which = np.unique(self._kept, return_inverse=True)
        each = [between.covariance(setting, constant=0.0) for setting in self._every[own]]
        plain = np.array(each)[which.reshape(self._kept.shape)]
        sizes, constants = np.square(SIZES)[:, None, None], np.square(CONSTANTS)[:, None, None]
        return np.asarray(sizes * plain + constants)

    def explained(self, blocks: Sequence[SurfaceBlock]) -> FloatArray:
        """Return the whitened covariances of n blocks with c cells, (s, `COMPONENTS`, c, n)."""
        if self._at is None:
            return np.zeros((len(self._kept), COMPONENTS, 0, len(blocks)))
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
        factor = np.linalg.cholesky(covariance)
        whitened = np.linalg.solve(factor, rests[..., None])[..., 0]
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
