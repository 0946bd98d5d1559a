"""A surface that is known: its posterior, and how strange its own blocks were when they came."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.special import gammaln

from mmt.core.arrays import FloatArray
from mmt.texture.surfaces.bands import COMPONENTS
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.cells import SurfaceCells
from mmt.texture.surfaces.conformal import ConformalBets
from mmt.texture.surfaces.posterior import Innovations, SurfacePosterior
from mmt.texture.surfaces.prior import NU

_PRIOR_BLOCKS: Final = 30.0
_LARGEST_COUNT: Final = 1000.0


class Felt(NamedTuple):
    """A block while the tool stays: its innovations (`COMPONENTS`,) and log density."""

    block: SurfaceBlock
    standardised: FloatArray
    log_density: float


class KnownSurface:
    """One surface; without blocks it is the prior, an unknown surface.

    Parameters
    ----------
    directed
        Whether the heading counts.
    """

    def __init__(self, *, directed: bool) -> None:
        self._cells = SurfaceCells(directed=directed)
        self._posterior = SurfacePosterior(self._cells)
        self._moments = np.eye(COMPONENTS)
        self._count = _PRIOR_BLOCKS
        self._bets = ConformalBets(COMPONENTS)

    @property
    def blocks(self) -> int:
        """Number of blocks learned."""
        return self._cells.blocks

    def explained(self, blocks: Sequence[SurfaceBlock]) -> FloatArray:
        """Return what `newest` can be given again of these blocks until blocks are learned."""
        return self._posterior.explained(blocks)

    def newest(self, blocks: Sequence[SurfaceBlock], explained: FloatArray) -> Felt:
        """Return what the last block is, given the surface and the blocks before it."""
        found = self._posterior.innovations(blocks, explained)
        standardised = found.standardised[-1]
        density = self._log_densities(Innovations(standardised[None], found.deviation[-1:]))
        return Felt(blocks[-1], standardised, float(density[0]))

    def log_bet(self, standardised: FloatArray) -> float:
        """Return the bet on the last of the newest innovations (n, `COMPONENTS`), a logarithm."""
        return self._bets.log_bet(standardised, self._whitening)

    @property
    def _whitening(self) -> FloatArray:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self._moments)))

    def judge(self, blocks: Sequence[SurfaceBlock]) -> tuple[FloatArray, FloatArray]:
        """Return the innovations (n, `COMPONENTS`) and log densities (n,) of n blocks in order."""
        found = self._posterior.innovations(blocks)
        return found.standardised, self._log_densities(found)

    def learn(self, felt: Sequence[Felt]) -> None:
        """Learn blocks of this surface, in their order."""
        if not felt:
            return
        self._cells.add([one.block for one in felt])
        self._posterior = SurfacePosterior(self._cells, self._posterior)
        self._bets.add(np.array([one.standardised for one in felt]))
        for one in felt:
            share = 1.0 / min(self._count + 1.0, _LARGEST_COUNT)
            outer = np.outer(one.standardised, one.standardised)
            outer /= max(float(np.trace(outer)) / (3.0 * COMPONENTS), 1.0)
            self._moments = self._moments + share * (outer - self._moments)
            self._count += 1.0

    def _squares(self, standardised: FloatArray) -> FloatArray:
        """Return the squared Mahalanobis lengths of innovations (..., `COMPONENTS`)."""
        return np.asarray(np.square(standardised @ self._whitening.T).sum(axis=-1))

    def _log_densities(self, found: Innovations) -> FloatArray:
        """Return log densities of the multivariate t distribution with `NU` degrees of freedom."""
        total = NU + COMPONENTS
        constant = gammaln(0.5 * total) - gammaln(0.5 * NU)
        constant -= 0.5 * COMPONENTS * np.log((NU - 2.0) * np.pi)
        constant -= 0.5 * np.linalg.slogdet(self._moments)[1]
        squares = self._squares(found.standardised)
        logarithms = np.log(found.deviation).sum(axis=-1)
        return np.asarray(constant - logarithms - 0.5 * total * np.log1p(squares / (NU - 2.0)))
