"""Blocks prepared for evaluating their likelihood under every surface."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.texture.surfaces.blocks import SurfaceBlock
from mmt.texture.surfaces.covariance import Covariances, SettingInputs
from mmt.texture.surfaces.prior import NOISE, PRIORS, cosine_transform


class PreparedBlocks:
    """Blocks in the order in which they are evaluated, prepared once for all surfaces.

    Parameters
    ----------
    inputs : (n, 2) or (n, 4)
        Inputs of n blocks.
    log_power : (n, `BANDS`)
        Log powers of their bands.
    settings : (k,)
        Settings of the prior, see `prior.Setting`.
    """

    def __init__(self, inputs: FloatArray, log_power: FloatArray, settings: RecordArray) -> None:
        self.places = SettingInputs(inputs, settings)
        values = log_power @ cosine_transform().T
        self.rests = {
            kind: values[:, prior.first : prior.last] - self.places.mean(prior)[:, :, None]
            for kind, prior in PRIORS.items()
        }
        """Residuals from the prior mean by kind of component, (k, n, c) or (1, n, c)."""

    def __len__(self) -> int:
        """Return the number of blocks."""
        return len(self.places.inputs)

    @classmethod
    def of(cls, blocks: Sequence[SurfaceBlock], settings: RecordArray) -> "PreparedBlocks":
        """Prepare blocks, at least one."""
        inputs = np.array([block.inputs for block in blocks])
        return cls(inputs, np.array([block.log_power for block in blocks]), settings)

    @cached_property
    def covariances(self) -> dict[str, FloatArray]:
        """Prior covariances (k, n, n) of components and noise, by kind; do not modify."""
        within = Covariances(self.places, self.places)
        found = {kind: within.of(prior) for kind, prior in PRIORS.items()}
        blocks = np.arange(len(self))
        for covariance in found.values():
            covariance[:, blocks, blocks] += NOISE * self.places.settings["noise"][:, None]
        return found

    @cached_property
    def unknown(self) -> FloatArray:
        """Log densities of the blocks on an unknown surface, as `log_densities`."""
        each = [log_densities(self.rests[kind], self.covariances[kind]) for kind in PRIORS]
        return np.asarray(np.sum(each, axis=0), dtype=np.float64)


def log_densities(rests: FloatArray, covariances: FloatArray) -> FloatArray:
    """Return log densities of the first block, the first two, and so on, shape (k, n).

    By the Cholesky factor. Beneath each covariance stand the rests as further rows: what the factor
    has there are the whitened rests, and so one call does for all. The corner makes the whole
    definite: by the noise no eigenvalue of a covariance is below `NOISE`, so that what the
    rests take from the corner is at most their squares over that.

    Parameters
    ----------
    rests
        Residuals of c components with one covariance, shape (k, n, c) or (1, n, c).
    covariances
        Shape (k, n, n).
    """
    number, blocks = covariances.shape[:2]
    components = rests.shape[2]
    whole = np.zeros((number, blocks + components, blocks + components))
    whole[:, :blocks, :blocks] = covariances
    whole[:, blocks:, :blocks] = rests.transpose(0, 2, 1)
    corner = np.arange(blocks, blocks + components)
    whole[:, corner, corner] = 1.0 + np.square(rests).sum(axis=(1, 2))[:, None] / (0.5 * NOISE)
    factors = np.linalg.cholesky(whole)
    scatter = components * np.log(2.0 * np.pi * np.square(np.diagonal(factors, axis1=1, axis2=2)))
    squares = np.square(factors[:, blocks:, :blocks]).sum(axis=1)
    return np.asarray(-0.5 * np.cumsum(squares + scatter[:, :blocks], axis=1), dtype=np.float64)
