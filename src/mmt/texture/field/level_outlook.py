"""What a model's level is worth over a grid, and where a further stroke would help most.

The level at a stroke is off by a normal error whose standard deviation the posterior of
`mmt.texture.field.level_process` tells, so that it cannot be told from the truth, by one JND, with
the probability ``erf(JND / (sd sqrt(2)))``. The mean of that over strokes is the share of them that
is expected to be right: where the standard deviations hold, its expectation is the true share.

One step ahead: a segment at stroke c, whose power would scatter by the variance r, takes
``cov(x, c)^2 / (var(c) + r)`` off the variance at every x (a rank-one update of the posterior,
Rasmussen and Williams 2006, eq. 2.26). What it will measure does not matter for that. So the gain
in the expected share follows for every c at once, O(g^2) for g nodes.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import erf

from mmt.core.arrays import FloatArray
from mmt.texture.completion.grid import CompletionGrid
from mmt.texture.field.level_process import DB, LevelProcess
from mmt.texture.signals.metrics import JND_DB

_LEAST: Final = 1e-12
"""Variances in nepers^2 count as no smaller: 4e-6 dB."""


def right_probability(deviation_db: FloatArray) -> FloatArray:
    """Return how likely a normal error of these standard deviations is within one JND."""
    least = DB * np.sqrt(_LEAST)
    return np.asarray(erf(JND_DB / (np.sqrt(2.0) * np.maximum(deviation_db, least))))


@dataclass(frozen=True, eq=False)
class Outlook:
    """Of every node of a grid, each shape (g,).

    Attributes
    ----------
    deviation_db
        Standard deviation of the level's error.
    right
        Probability that it is within one JND.
    gain
        By how much a further segment there would raise the weighted share.
    """

    deviation_db: FloatArray
    right: FloatArray
    gain: FloatArray

    def share(self, weights: FloatArray) -> float:
        """Return the expected share, weighted by (g,) weights whose sum is 1."""
        return float(np.clip(self.right @ weights, 0.0, 1.0))


def outlook(process: LevelProcess, grid: CompletionGrid, weights: FloatArray) -> Outlook:
    """Return what a posterior says over a grid whose nodes have weights (g,)."""
    covariance = process.covariance_on_grid(grid.axes)
    variance = np.maximum(np.einsum("ii->i", covariance), _LEAST)
    gained = np.square(covariance) / (variance + process.segment_variance)[:, None]
    after = right_probability(DB * np.sqrt(np.maximum(variance - gained, _LEAST)))
    deviation_db = DB * np.sqrt(variance)
    right = right_probability(deviation_db)
    return Outlook(deviation_db, right, np.asarray(after @ weights - right @ weights))
