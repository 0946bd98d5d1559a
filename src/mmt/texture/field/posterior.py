"""Posterior of a texture's level over speed, force and heading.

A Gaussian process on the log power of blocks (Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, sections 2.2 and 5.2), whose prior is in `mmt.texture.field.covariance`.
Each cell of strokes counts as one observation, with the error that is estimated in
`mmt.texture.field.observations`.

The posterior is a mixture over `SETTINGS` hyperparameters, each weighted by its evidence, so that
the standard deviation includes the uncertainty of the texture's smoothness.

A texture is steeper in some places than in others. So the errors of a setting are not normal: each
has Student's t distribution with 3 degrees of freedom, whose scale is `TAIL_SCALE` of the process'
standard deviation.

Cost: O(c^3) for each setting with weight and c touched cells, of which there are at most 440, or
780 with headings, however long the session is.
"""

from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import UNKNOWN_SIZE
from mmt.texture.field.blocks import BLOCK_S
from mmt.texture.field.cells import FELT_POWER, FieldCells
from mmt.texture.field.covariance import (
    Coordinates,
    coordinates,
    mean_on_grid,
    prior_covariance,
    settings,
    variance,
    warped,
)
from mmt.texture.field.observations import BLOCK_VARIANCE, Choice, choose, observe
from mmt.texture.interpolation.interpolant import table_grid
from mmt.texture.linear_algebra import (
    cholesky,
    log_evidence,
    product,
    solve_backward,
    solve_forward,
)
from mmt.texture.space import TextureSamples

DB: Final = 10.0 / np.log(10.0)
"""Decibels in a neper of power."""

SETTINGS: Final = 16
"""Number of settings of the hyperparameters in the mixture."""

TAIL_SCALE: Final = 0.8
"""Scale of the errors' distribution over the standard deviation of the process. Errors on the 50
models of the prior, with noise, after 3, 10, 20 and 30 s, are likeliest with 3 or 4 degrees of
freedom and a scale of 0.75 to 0.85."""

_NEGLIGIBLE: Final = 1e-3  # weight of a setting that is left out
_LEAST_EXPONENT: Final = 0.2
_RISE: Final = 6.0  # nepers above the loudest cell, at most
_LEAST: Final = -690.0  # nepers, above what underflows
_LEAST_SHARE: Final = 1e-3  # of a level, left after `FELT_POWER` is taken out
_LEAST_VARIANCE: Final = 1e-12


class Prediction(NamedTuple):
    """The posterior at k strokes under s settings: weights (s,), means and variances (s, k)."""

    weights: FloatArray
    means: FloatArray
    variances: FloatArray

    @property
    def mean(self) -> FloatArray:
        """Mean of the log power, nepers, (k,)."""
        return np.asarray(self.weights @ self.means)

    @property
    def deviation(self) -> FloatArray:
        """Standard deviation of the log power, nepers, (k,)."""
        own = 3.0 * TAIL_SCALE**2 * self.variances
        second = self.weights @ (own + np.square(self.means - self.mean))
        return np.asarray(np.sqrt(np.maximum(second, _LEAST_VARIANCE)))

    def within(self, nepers: float) -> FloatArray:
        """Return the probability (k,) that the mean is right to this many nepers."""
        each = right_probability(nepers, self.variances, self.means - self.mean)
        return np.asarray(np.clip(self.weights @ each, 0.0, 1.0))


def right_probability(
    nepers: float, variances: FloatArray, off: FloatArray | float = 0.0
) -> FloatArray:
    """Return the probability that errors are at most this many nepers, any shape.

    Parameters
    ----------
    nepers
        Above zero.
    variances, off
        Variances of the process (nepers^2, positive) and means of the errors.
    """
    width = TAIL_SCALE * np.sqrt(variances)
    if np.isscalar(off) and off == 0.0:
        return _central_share(nepers / width)
    return np.asarray(
        0.5 * (_central_share((nepers - off) / width) + _central_share((nepers + off) / width))
    )


def _central_share(bound: FloatArray) -> FloatArray:
    """Return the probability of Student's t, 3 degrees of freedom, between -bound and bound.

    It is odd: negative for negative bounds.
    """
    angle = np.arctan(bound / np.sqrt(3.0))
    return np.asarray((2.0 * angle + np.sin(2.0 * angle)) / np.pi)


class _Member(NamedTuple):
    """One setting of the mixture: its weight, the Cholesky factor of its cells, their weights."""

    weight: float
    setting: FloatArray
    factor: FloatArray
    cell_weights: FloatArray


class LevelField:
    """The posterior of the level's logarithm; immutable.

    Parameters
    ----------
    cells
        Blocks, at least one.
    noise_power
        Noise power of the sensor, which is subtracted from every power.
    gain
        Factor on the power of each cell of strokes, (c,), or of all.
    """

    def __init__(
        self, cells: FieldCells, *, noise_power: float = 0.0, gain: FloatArray | float = 1.0
    ) -> None:
        self.cells = cells
        self.directed = cells.directed
        self._at = at = cells.centres
        every = settings(SETTINGS, directed=self.directed)
        choice = choose(cells, every)
        self.observed = found = observe(cells, every, choice)
        share = self._share(found.smoothed + at.law, noise_power)
        level = found.level + np.log(gain * share)
        self._loudest = float((found.smoothed + at.law).max())
        self._middle = float(np.average(level, weights=1.0 / found.variance))
        errors = found.variance / np.square(share)
        self._members = _mixture(every, at, choice, level - self._middle, errors)

    def predict(self, at: Coordinates) -> Prediction:
        """Return the posterior of the level itself, without scatter of blocks, at k strokes."""
        return self._predicted(at)[0]

    def predict_jointly(self, at: Coordinates) -> tuple[Prediction, FloatArray]:
        """Return the posterior at k strokes, and the covariance among them, (k, k), nepers^2.

        The covariance is that of the setting with the largest weight.
        """
        found, explained = self._predicted(at)
        likeliest = int(found.weights.argmax())
        within = prior_covariance(at, at, self._members[likeliest].setting)
        white = explained[likeliest]
        return found, within - product(white, np.ascontiguousarray(white.T))

    def _predicted(self, at: Coordinates) -> tuple[Prediction, list[FloatArray]]:
        """Return the posterior, and each setting's covariance with the cells, whitened."""
        every = np.array([member.setting for member in self._members])
        means, variances, explained = [], [], []
        for member, prior in zip(self._members, prior_covariance(at, self._at, every), strict=True):
            white = solve_forward(member.factor, prior)
            mean = np.einsum("ij,j->i", prior, member.cell_weights)
            means.append(mean + self._middle + at.law)
            variances.append(variance(at, member.setting) - np.square(white).sum(axis=1))
            explained.append(white)
        weights = np.array([member.weight for member in self._members])
        found = Prediction(weights, np.array(means), np.maximum(variances, _LEAST_VARIANCE))
        return found, explained

    def level_db(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation of the level, each (k,), in dB; 0 dB is 1 (m/s2)^2.

        Parameters
        ----------
        points
            Normalised, shape (k, 2) or (k, 3).
        """
        found = self.predict(coordinates(points))
        return DB * _rendered(found.mean), DB * found.deviation

    @property
    def second_variance(self) -> float:
        """Variance, nepers^2, of the mean level of a further second of stroking in one place."""
        return self.observed.block * BLOCK_S + self.observed.moment

    @cached_property
    def table(self) -> FloatArray:
        """The mean, in nepers, on the grid of `mmt.texture.interpolation.interpolant`.

        Shape (headings, speeds, forces). Below the slowest and the lightest cell it falls
        towards zero at least as speed^0.2 and force^0.2, whatever the blocks say.
        """
        speed, force, heading = table_grid(directed=self.directed)
        axes = Coordinates(warped(speed), warped(force), heading)
        weights = np.array([member.weight * member.cell_weights for member in self._members])
        every = np.array([member.setting for member in self._members])
        total = mean_on_grid(axes, self._at, weights, every)
        law = Coordinates(axes.u[:, None], axes.v[None, :], axes.heading).law
        levels = _rendered(np.asarray(total + self._middle + law))
        _fall(np.moveaxis(levels, 1, 0), axes.u, speed, float(self._at.u.min()))
        _fall(np.moveaxis(levels, 2, 0), axes.v, force, float(self._at.v.min()))
        return np.clip(levels, _LEAST, self._loudest + _RISE)

    @staticmethod
    def _share(level: FloatArray, noise_power: float) -> FloatArray:
        """Return the share of each cell's power that is not the sensor's noise, (c,).

        The smoothed power is used: with each cell's own power, cells that are loud by chance would
        count for more. At least `FELT_POWER` is left.
        """
        least = FELT_POWER / (FELT_POWER + noise_power)
        return np.asarray(np.maximum(1.0 - noise_power * np.exp(-level), least))


def _mixture(
    every: FloatArray, at: Coordinates, choice: Choice, rest: FloatArray, errors: FloatArray
) -> list[_Member]:
    """Return the settings, weighted by their evidence; `rest` (c,) are the observations."""
    evidence = log_evidence(choice.priors, errors[choice.cells], rest[choice.cells])
    weights = np.exp(evidence - evidence.max())
    weights[weights < _NEGLIGIBLE] = 0.0
    weights /= weights.sum()
    kept = np.flatnonzero(weights)
    members = []
    for each, prior in zip(kept, prior_covariance(at, at, every[kept]), strict=True):
        factor = cholesky(prior + np.diag(errors))
        cell_weights = solve_backward(factor, solve_forward(factor, rest))
        members.append(_Member(float(weights[each]), every[each], factor, cell_weights))
    return members


def field_of_samples(samples: TextureSamples) -> LevelField | None:
    """Return the field of a model's segments, or None if none has any power.

    For models without blocks: each segment counts as the number of blocks that the effective
    sample size of its power is worth.
    """
    known = samples.power > 0.0
    if not known.any():
        return None
    effective = samples.effective
    if effective is None:
        effective = np.full(len(samples), UNKNOWN_SIZE)
    blocks = np.maximum(0.5 * BLOCK_VARIANCE * effective, 0.1)  # a power scatters by 2 / effective
    cells = FieldCells.of_segments(
        samples.points[known], samples.power[known], blocks[known], BLOCK_VARIANCE
    )
    return LevelField(cells, noise_power=samples.noise_power)


def _rendered(level: FloatArray) -> FloatArray:
    """Return the log power to render, without the `FELT_POWER` that all blocks include."""
    share = 1.0 - FELT_POWER * np.exp(-np.maximum(level, np.log(FELT_POWER)))
    return level + np.log(np.maximum(share, _LEAST_SHARE))


def _fall(levels: FloatArray, axis: FloatArray, values: FloatArray, lowest: float) -> None:
    """Make levels (nodes, ...) fall towards zero below the lowest cell of an axis."""
    first = int(np.searchsorted(axis, lowest))
    steps = _LEAST_EXPONENT * np.diff(np.log(values))
    for node in range(min(first, len(axis) - 1) - 1, -1, -1):
        np.minimum(levels[node], levels[node + 1] - steps[node], out=levels[node])
