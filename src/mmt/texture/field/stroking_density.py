"""Where an operator strokes: how likely each stroke of a grid is to come next.

Assumption: what comes next is drawn from a Dirichlet process whose base measure is even over the
grid and weighs as much as `PRIOR_S` of stroking. Then the next moment is a stroke that was seen
before, as often as it was, with the probability t / (t + `PRIOR_S`) after t seconds of
stroking, and any stroke at all otherwise (Ferguson, A Bayesian analysis of some nonparametric
problems, Annals of Statistics 1, 1973; Blackwell and MacQueen, ibid., eq. 1). So the
unexplored counts, and the less the longer the operator leaves it out.

A moment of stroking counts for the nodes around it, by a Gaussian in the logarithms of speed and
force, and in the heading; beyond the grid's ends it counts as lying there.
"""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.completion.grid import CompletionGrid
from mmt.texture.signals.aligned import AlignedBlock

PRIOR_S: Final = 10.0
"""Our choice: about what the published criterion takes to stop, so that then half is even."""

_WIDTHS: Final = (0.25, 0.25, 0.35)  # nepers, nepers, rad
_STEP: Final = 10  # samples: a stroke changes little within 10 ms


class StrokingDensity:
    """Weigh a grid's nodes by the motion so far.

    Parameters
    ----------
    grid
        The strokes.
    least_speed_mm_s, least_force_n
        Slower and lighter motion is no stroking.
    rate_hz
        Of the stream.
    """

    def __init__(
        self, grid: CompletionGrid, least_speed_mm_s: float, least_force_n: float, rate_hz: float
    ) -> None:
        self._grid = grid
        self._least = least_speed_mm_s, least_force_n
        self._moment_s = _STEP / rate_hz
        self._seconds = np.zeros(len(grid))

    def add(self, block: AlignedBlock) -> None:
        """Take the newest motion."""
        stroking = block.valid & (block.speed_mm_s >= self._least[0])
        stroking &= block.normal_force_n >= self._least[1]
        chosen = np.flatnonzero(stroking)[::_STEP]
        if not len(chosen):
            return
        space, axes = self._grid.space, self._grid.axes
        speed = np.log(block.speed_mm_s[chosen] / space.maximum_speed_mm_s)
        force = np.log(block.normal_force_n[chosen] / space.maximum_force_n)
        velocity = block.velocity_mm_s[chosen]
        turn = np.subtract.outer(axes.heading, np.arctan2(velocity[:, 1], velocity[:, 0]))
        across = _near(axes.speed, np.clip(speed, axes.speed[0], axes.speed[-1]), _WIDTHS[0])
        along = _near(axes.force, np.clip(force, axes.force[0], axes.force[-1]), _WIDTHS[1])
        around = _shares(2.0 * np.sin(0.5 * turn), _WIDTHS[2])  # one heading: it alone
        self._seconds += self._moment_s * np.einsum("hk,sk,fk->hsf", around, across, along).ravel()

    @property
    def seconds(self) -> FloatArray:
        """How long the operator has stroked at each node, shape (g,)."""
        return self._seconds.copy()

    @property
    def weights(self) -> FloatArray:
        """The probability of each node, shape (g,), all above zero, with the sum 1."""
        seconds = self._seconds + PRIOR_S / len(self._seconds)
        return np.asarray(seconds / seconds.sum())


def _near(axis: FloatArray, values: FloatArray, width: float) -> FloatArray:
    return _shares(np.subtract.outer(axis, values), width)


def _shares(apart: FloatArray, width: float) -> FloatArray:
    """Return how a moment counts for the nodes of an axis, shape (nodes, k), summing to 1."""
    square = np.square(apart / width)
    near = np.exp(-0.5 * (square - square.min(axis=0)))
    return np.asarray(near / near.sum(axis=0))
