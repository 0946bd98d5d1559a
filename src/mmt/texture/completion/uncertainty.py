"""Completion by uncertainty: the expected share of an operator's strokes rendered within one JND.

The posterior of the level (`mmt.texture.field.posterior`) gives the probability that the level
at a stroke is within one just noticeable difference of the truth. The value of the criterion is the
mean of that probability over a grid of strokes, weighted by an estimate of where this operator
strokes (`StrokingDensity`). It is the expectation of a share that `mmt lab compare` measures.

It does not include errors of the spectrum's shape, which has no posterior here, or of vibration
that the stream does not contain, such as that far below the corner of the high-pass.

*Level.* The posterior is a mixture of Student's t distributions, one for each setting of its
hyperparameters. The probability is the mixture's within one JND of its mean.

*One step ahead.* A second of stroking at c whose power scatters with variance r reduces the
variance at every x by ``cov(x, c)^2 / (var(c) + r)``, whatever it measures (a rank-one update;
Rasmussen and Williams 2006, eq. 2.26). This gives the gain in the expected share for every c at
once, in O(g^2) for g nodes, by the likeliest setting.

*Strokes.* The grid covers the whole plane (`mmt.texture.completion.distance`), as evaluations do.
The next stroke is taken to come from a Dirichlet process whose base measure is uniform over the
grid with the weight of `PRIOR_S` of stroking: after t seconds it repeats an earlier stroke with
probability t / (t + `PRIOR_S`) (Ferguson, "A Bayesian analysis of some nonparametric problems",
Annals of Statistics 1, 1973; Blackwell and MacQueen, ibid., eq. 1). So unexplored strokes count,
and count less the longer the operator leaves them out. A moment of stroking is divided among the
nodes around it by the weights of linear interpolation; moments beyond the grid count at its edge.
"""

from functools import cached_property
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.texture.completion.criterion import Criterion, Progress
from mmt.texture.completion.distance import (
    DIVISIONS,
    FORCE_RANGE_N,
    SPEED_RANGE_MM_S,
    cells_of,
    middles,
)
from mmt.texture.field.covariance import Coordinates, grid_nodes, points_at, warped
from mmt.texture.field.posterior import DB, LevelField, right_probability
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import JND_DB, ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.space import InputSpace

_PLANAR_SHAPE: Final = (1, 12, 12)
_DIRECTED_SHAPE: Final = (12, 5, 5)
"""Number of headings, speeds and forces."""


class CompletionGrid:
    """Grid of strokes, evenly spaced in speed, force and heading.

    Parameters
    ----------
    space
        Input space of the model.

    Attributes
    ----------
    speed, force, heading
        Axes: normalised speeds and forces, and headings.
    strokes, points
        The nodes, in the order of `covariance.grid_nodes`: in the field's coordinates, (g,) each,
        and normalised, (g, d).
    """

    def __init__(self, space: InputSpace) -> None:
        headings, speeds, forces = _DIRECTED_SHAPE if space.directed else _PLANAR_SHAPE
        turn = np.linspace(0.0, 2.0 * np.pi, headings, endpoint=False) + np.pi / headings
        self.space = space
        self.speed = middles(SPEED_RANGE_MM_S, speeds) / space.maximum_speed_mm_s
        self.force = middles(FORCE_RANGE_N, forces) / space.maximum_force_n
        self.heading = turn if space.directed else 0.0 * turn
        axes = Coordinates(warped(self.speed), warped(self.force), self.heading)
        self.strokes = grid_nodes(axes)
        self.points = points_at(self.strokes, directed=space.directed)

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def cells(self) -> IntArray:
        """Index of the cell of `distance.cells_of` that holds each node, shape (g,)."""
        places = self.points.copy()
        if self.space.directed:
            places[:, :2] = 0.5 * (places[:, :2] + 1.0)
        steps = np.clip((places * DIVISIONS).astype(np.int64), 0, DIVISIONS - 1)
        strides = DIVISIONS ** np.arange(self.space.dimensions)
        return np.asarray(steps @ strides)

    def mean_of_cells(self, values: FloatArray) -> FloatArray:
        """Return the mean of the nodes' values (g,) in each cell, shape (c,)."""
        count = len(cells_of(self.space.dimensions).centres)
        total = np.bincount(self.cells, values, minlength=count)
        return np.asarray(total / np.bincount(self.cells, minlength=count))


PRIOR_S: Final = 10.0
"""Weight of the uniform base measure, in seconds of stroking. The published criterion takes about
as long to stop; half of the density is still uniform then."""

_STEP: Final = 10  # samples: a stroke changes little within 10 ms


class StrokingDensity:
    """Probability density of the operator's strokes over the nodes of a grid.

    Parameters
    ----------
    grid
        Grid of strokes.
    settings
        Least speed and force of a stroke, and the stream's rate.
    """

    def __init__(self, grid: CompletionGrid, settings: ModellingSettings) -> None:
        self._grid, self._settings = grid, settings
        self._moment_s = _STEP / settings.rate_hz
        self._seconds = np.zeros(len(grid))

    def add(self, block: AlignedBlock) -> None:
        """Add the newest block of aligned samples."""
        stroking = block.valid & (block.speed_mm_s >= self._settings.least_speed_mm_s)
        stroking &= block.normal_force_n >= self._settings.least_force_n
        chosen = np.flatnonzero(stroking)[::_STEP]
        if not len(chosen):
            return
        space, grid = self._grid.space, self._grid
        velocity = block.velocity_mm_s[chosen]
        turn = np.subtract.outer(grid.heading, np.arctan2(velocity[:, 1], velocity[:, 0]))
        across = _shares(grid.speed, block.speed_mm_s[chosen] / space.maximum_speed_mm_s)
        along = _shares(grid.force, block.normal_force_n[chosen] / space.maximum_force_n)
        around = _hat(2.0 * np.pi / len(grid.heading), (turn + np.pi) % (2.0 * np.pi) - np.pi)
        around /= around.sum(axis=0)
        self._seconds += self._moment_s * np.einsum("hk,sk,fk->hsf", around, across, along).ravel()

    @property
    def total_s(self) -> float:
        """Seconds of stroking at all nodes."""
        return float(self._seconds.sum())

    @property
    def weights(self) -> FloatArray:
        """The probability of each node, shape (g,), all above zero, with the sum 1."""
        seconds = self._seconds + PRIOR_S / len(self._seconds)
        return np.asarray(seconds / seconds.sum())


def _shares(axis: FloatArray, values: FloatArray) -> FloatArray:
    """Return the weights of k values between the even nodes of an axis, shape (nodes, k)."""
    inside = np.clip(values, axis[0], axis[-1])
    return _hat(axis[1] - axis[0], np.subtract.outer(axis, inside))


def _hat(step: float, apart: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(1.0 - np.abs(apart) / step, 0.0))


_NEWS, _NEWS_ONCE_STOPPED = 1.02, 1.1
"""Ratio of the seconds of stroking to those at the last evaluation from which a model is evaluated
again: a threshold is met 2 % late at most. After the last one nothing depends on the value."""

_LEAST: Final = 1e-12
"""Least variance in nepers^2: a standard deviation of 4e-6 dB."""


def predict_gains(
    field: LevelField, grid: CompletionGrid, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how likely the level is right at the nodes of a grid, and what stroking there gains.

    Parameters
    ----------
    field
        The posterior.
    grid
        Strokes.
    weights
        Weights of the nodes, (g,), with the sum 1.

    Returns
    -------
    right, gain
        The probability that the level is within one JND, and the increase of the weighted share by
        a further second of stroking at that node, both (g,).
    """
    found, covariance = field.predict_jointly(grid.strokes)
    variance = np.maximum(np.diagonal(covariance), _LEAST)
    gained = np.square(covariance) / (variance + field.second_variance)[:, None]
    nepers = JND_DB / DB
    after = right_probability(nepers, np.maximum(variance - gained, _LEAST))
    gain = after @ weights - right_probability(nepers, variance) @ weights
    return found.within(nepers), np.asarray(gain)


class UncertaintyCriterion(Criterion):
    """Completion criterion on the uncertainty of the level.

    Parameters
    ----------
    settings
        Modelling settings: inputs, thresholds, least speed and force of a stroke.
    """

    def __init__(self, settings: ModellingSettings) -> None:
        super().__init__(settings.scale)
        self.grid = CompletionGrid(InputSpace(settings.inputs))
        self.density = StrokingDensity(self.grid, settings)
        nothing = self.grid.mean_of_cells(np.zeros(len(self.grid)))
        self.progress = self._nothing = Progress(self.scale, 0.0, tuple(nothing.tolist()))
        self._evaluated_s = 0.0

    @property
    def due(self) -> bool:
        """Whether there is enough new stroking to evaluate a model again."""
        news = _NEWS_ONCE_STOPPED if self.stopped else _NEWS
        return self.density.total_s > news * self._evaluated_s

    def update(self, model: TextureModel | None, time_s: float) -> None:
        """Evaluate the model at a session time (s); the share is 0 without a model or any power."""
        field = None if model is None else model.level_field
        if field is None:
            self.progress = self._nothing
            return
        self._evaluated_s = self.density.total_s
        weights = self.density.weights
        advice = None  # needed no more once stopped
        if self.stopped:
            right = field.predict(self.grid.strokes).within(JND_DB / DB)
        else:
            right, gain = predict_gains(field, self.grid, weights)
            best = self.grid.points[int(np.argmax(gain))] * self.grid.space.scale
            advice = tuple(best.tolist())
        self.progress = Progress(
            scale=self.scale,
            value=float(np.clip(right @ weights, 0.0, 1.0)),
            cells=tuple(self.grid.mean_of_cells(right).tolist()),
            advice=advice,
        )
        self.record_value(self.progress.value, time_s)
