"""Blocks in the form in which every surface is asked how likely it makes them."""

from collections.abc import Sequence

import numpy as np

from mmt.arrays import FloatArray
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.prior import NOISE, PRIORS, Distances, Setting, mean_of, turning


class HeardBlocks:
    """Blocks in the order in which they are to be judged, prepared once for all surfaces.

    Parameters
    ----------
    inputs : (n, 2) or (n, 4)
        Of n blocks.
    log_power : (n, `BANDS`)
        Of the same.
    """

    def __init__(self, inputs: FloatArray, log_power: FloatArray) -> None:
        self.inputs = inputs
        self._within = Distances(inputs, inputs)
        self._covariances: dict[tuple[str, Setting], FloatArray] = {}
        values = log_power @ turning().T
        self.rests = {
            kind: values[:, prior.first : prior.last] - mean_of(prior, inputs)
            for kind, prior in PRIORS.items()
        }
        """By kind of component, what is left of it without the prior's mean, (n, c)."""

    @classmethod
    def of(cls, blocks: Sequence[SurfaceBlock]) -> "HeardBlocks":
        """Prepare blocks, at least one."""
        inputs = np.array([block.inputs for block in blocks])
        return cls(inputs, np.array([block.log_power for block in blocks]))

    def covariance(self, kind: str, setting: Setting) -> FloatArray:
        """Return the prior covariance of a kind of component and of the noise, (n, n); read it."""
        found = self._covariances.get((kind, setting))
        if found is None:
            found = self._within.covariance(PRIORS[kind], setting)
            found.flat[:: len(found) + 1] += setting.noise * NOISE
            self._covariances[kind, setting] = found
        return found
