"""A surface that is known: its posterior, and how its innovations scatter together."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.special import gammaln

from mmt.core.arrays import FloatArray
from mmt.texture.surfaces.bands import COMPONENTS
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.cells import SurfaceCells
from mmt.texture.surfaces.posterior import Innovations, SurfacePosterior
from mmt.texture.surfaces.prior import NU

KNOCK: Final = 5.0
"""Standard deviations beyond which an innovation is learned as no larger: a knock is none of the
texture's."""

_PRIOR_BLOCKS: Final = 30.0
_LARGEST_COUNT: Final = 1000.0


class Felt(NamedTuple):
    """A block while the tool stays: its innovations and their deviations, and its log density.

    The two are of shape (`COMPONENTS`,) each.
    """

    block: SurfaceBlock
    standardised: FloatArray
    deviation: FloatArray
    log_density: float

    @property
    def tamed(self) -> SurfaceBlock:
        """The block as it is learned: no innovation is larger than `KNOCK`."""
        beyond = self.standardised - np.clip(self.standardised, -KNOCK, KNOCK)
        return replace(self.block, values=self.block.values - beyond * self.deviation)


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
        density = self._densities(Innovations(standardised[None], found.deviation[-1:]))
        return Felt(blocks[-1], standardised, found.deviation[-1], float(density[0]))

    def log_densities(self, blocks: Sequence[SurfaceBlock]) -> FloatArray:
        """Return the log density (n,) of each of n blocks, given the surface and those before."""
        return self._densities(self._posterior.innovations(blocks))

    def learn(self, felt: Sequence[Felt]) -> None:
        """Learn blocks of this surface, in their order."""
        if not felt:
            return
        self._cells.add([one.tamed for one in felt])
        self._posterior = SurfacePosterior(self._cells)
        for one in felt:
            share = 1.0 / min(self._count + 1.0, _LARGEST_COUNT)
            outer = np.outer(one.standardised, one.standardised)
            outer /= max(float(np.trace(outer)) / (3.0 * COMPONENTS), 1.0)
            self._moments = self._moments + share * (outer - self._moments)
            self._count += 1.0

    def _densities(self, found: Innovations) -> FloatArray:
        """Return log densities of the multivariate t distribution with `NU` degrees of freedom."""
        total = NU + COMPONENTS
        constant = gammaln(0.5 * total) - gammaln(0.5 * NU)
        constant -= 0.5 * COMPONENTS * np.log((NU - 2.0) * np.pi)
        constant -= 0.5 * np.linalg.slogdet(self._moments)[1]
        whitening = np.linalg.inv(np.linalg.cholesky(self._moments))
        squares = np.square(found.standardised @ whitening.T).sum(axis=-1)
        logarithms = np.log(found.deviation).sum(axis=-1)
        return np.asarray(constant - logarithms - 0.5 * total * np.log1p(squares / (NU - 2.0)))
